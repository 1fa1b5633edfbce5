#include "sim/forward_source.h"

#include <condition_variable>
#include <deque>
#include <exception>
#include <mutex>
#include <thread>

#include "core/error.h"

namespace binrig {
namespace {

struct Stopped {};  // leaves the simulation from inside its sink

class ForwardSource : public FrameSource {
 public:
  ForwardSource(const std::string& uri, std::shared_ptr<const ForwardModel> forward, const SensorModel& model,
                std::vector<int> captures, std::uint64_t seed)
      : forward_(std::move(forward)), model_(model), captures_(std::move(captures)), seed_(seed) {
    if (captures_.empty()) {
      for (std::size_t i = 0; i < forward_->captures().size(); ++i) captures_.push_back(static_cast<int>(i));
    }
    info_.uri = uri;
    info_.sensor = forward_->set().sensor;
    info_.valid_region = forward_->set().valid_region;
    std::int64_t frames = 0;
    for (int capture : captures_) frames += forward_->captures()[capture].frames;
    info_.frames = frames;
    info_.power_on = forward_->captures()[captures_.front()].power_on;
    SimulationRequest first = request_for(captures_.front());
    first.frames = 1;
    forward_->simulate(first, [&](const Frame& frame, int) {
      info_.camera = frame.camera;
      info_.depth_scale_mm = frame.depth_scale_mm;
    });
  }

  ~ForwardSource() override { stop(); }

  SourceInfo info() const override { return info_; }

  void start() override {
    if (worker_.joinable()) throw Error(info_.uri + " is running already: stop() comes before start()");
    ready_.clear();
    failure_ = nullptr;
    stopping_ = finished_ = false;
    worker_ = std::thread([this] { produce(); });
  }

  void stop() override {
    if (!worker_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    changed_.notify_all();
    worker_.join();
  }

  std::optional<Frame> next(std::chrono::milliseconds timeout) override {
    if (!worker_.joinable()) throw Error(info_.uri + " is not running: start() comes before next()");
    std::unique_lock lock(mutex_);
    const bool answered = changed_.wait_for(lock, timeout, [&] { return !ready_.empty() || finished_; });
    if (!answered) {
      Frame late;
      late.camera = info_.camera;
      late.status = FrameStatus::timeout;
      return late;
    }
    if (!ready_.empty()) {
      Frame frame = std::move(ready_.front());
      ready_.pop_front();
      lock.unlock();
      changed_.notify_all();
      return frame;
    }
    if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
    return std::nullopt;
  }

 private:
  SimulationRequest request_for(int capture) const {
    SimulationRequest request;
    request.capture = capture;
    request.model = &model_;
    request.seed = seed_;
    return request;
  }

  void produce() {
    try {
      std::int64_t sequence = 0;
      for (int capture : captures_) {
        forward_->simulate(request_for(capture), [&](const Frame& frame, int) {
          Frame copy = frame;  // a simulation may use its images again
          for (cv::Mat* image : {&copy.depth_mm, &copy.reason, &copy.ir, &copy.rgb, &copy.ids}) *image = image->clone();
          copy.sequence = sequence++;
          std::unique_lock lock(mutex_);
          changed_.wait(lock, [&] { return ready_.size() < 4 || stopping_; });
          if (stopping_) throw Stopped{};
          ready_.push_back(std::move(copy));
          lock.unlock();
          changed_.notify_all();
        });
      }
    } catch (const Stopped&) {
    } catch (...) {
      const std::lock_guard lock(mutex_);
      failure_ = std::current_exception();
    }
    {
      const std::lock_guard lock(mutex_);
      finished_ = true;
    }
    changed_.notify_all();
  }

  std::shared_ptr<const ForwardModel> forward_;
  SensorModel model_;
  std::vector<int> captures_;
  std::uint64_t seed_;
  SourceInfo info_;
  std::thread worker_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Frame> ready_;
  std::exception_ptr failure_;
  bool stopping_ = false, finished_ = false;
};

}  // namespace

std::unique_ptr<FrameSource> make_forward_source(const std::string& uri, std::shared_ptr<const ForwardModel> forward,
                                                 const SensorModel& model, std::vector<int> captures,
                                                 std::uint64_t seed) {
  return std::make_unique<ForwardSource>(uri, std::move(forward), model, std::move(captures), seed);
}

}  // namespace binrig
