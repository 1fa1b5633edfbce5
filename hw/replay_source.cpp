#include "hw/replay_source.h"

#include <algorithm>
#include <thread>

#include "core/error.h"
#include "core/recording_set.h"

namespace binrig {
namespace {

using Clock = std::chrono::steady_clock;

class ReplaySource : public FrameSource {
 public:
  explicit ReplaySource(Uri uri) : set_(RecordingSet::open(uri.path)) {
    info_.uri = uri.text;
    const std::string rate = uri.take("rate").value_or("max"), loop = uri.take("loop").value_or("0");
    Violations violations;
    if (rate != "real" && rate != "max") violations.add({uri.text, "rate", rate, "", "real, max", ""});
    if (loop != "0" && loop != "1") violations.add({uri.text, "loop", loop, "", "0, 1", ""});
    violations.throw_if_any("the recording cannot be replayed");
    uri.finish({"rate", "loop"});
    real_time_ = rate == "real";
    loop_ = loop == "1";
    if (uri.fragment.empty()) {
      for (const CaptureInfo& capture : set_.captures()) captures_.push_back(set_.capture(capture.split, capture.id));
    } else {
      captures_.push_back(set_.capture(uri.fragment));
    }
    std::int64_t frames = 0;
    for (const CaptureReader& capture : captures_) frames += capture.size();
    if (frames == 0) throw Error(uri.text + " holds no frames");
    if (!loop_) info_.frames = frames;
    info_.sensor = set_.info().sensor;
    info_.power_on = captures_.front().info().power_on;
    info_.valid_region = set_.info().valid_region;
    describe_first_frame();
  }

  SourceInfo info() const override { return info_; }

  void start() override {
    if (running_) throw Error(info_.uri + " is running already: stop() comes before start()");
    running_ = true;
    capture_ = frame_ = 0;
    last_time_s_.reset();
  }

  void stop() override { running_ = false; }

  std::optional<Frame> next(std::chrono::milliseconds timeout) override {
    if (!running_) throw Error(info_.uri + " is not running: start() comes before next()");
    while (capture_ < captures_.size() && frame_ >= captures_[capture_].size()) {
      ++capture_;
      frame_ = 0;
      last_time_s_.reset();
    }
    if (capture_ == captures_.size()) {
      if (!loop_) return std::nullopt;
      capture_ = frame_ = 0;
      return next(timeout);
    }
    const CaptureReader& capture = captures_[capture_];
    if (real_time_ && !wait_for(capture.header(frame_), timeout)) {
      Frame late;
      late.camera = info_.camera;
      late.status = FrameStatus::timeout;
      return late;
    }
    return capture.frame(frame_++);  // counts on, even where the frame is broken
  }

 private:
  // The image size is in the images alone; a broken first frame must not hide the others.
  void describe_first_frame() {
    for (const CaptureReader& capture : captures_) {
      for (int i = 0; i < capture.size(); ++i) {
        try {
          const Frame frame = capture.frame(i);
          if (frame.camera.width == 0) continue;
          info_.camera = frame.camera;
          info_.depth_scale_mm = frame.depth_scale_mm;
          return;
        } catch (const Error&) {
          if (i + 1 == capture.size() && &capture == &captures_.back()) throw;
        }
      }
    }
  }

  // False if the frame is not due within the timeout.
  bool wait_for(const Frame& header, std::chrono::milliseconds timeout) {
    if (!header.time_s) return true;
    const Clock::time_point now = Clock::now();
    if (!last_time_s_) {
      last_time_s_ = *header.time_s;
      last_due_ = now;
      return true;
    }
    const auto due = last_due_ + std::chrono::duration_cast<Clock::duration>(
                                     std::chrono::duration<double>(std::max(0.0, *header.time_s - *last_time_s_)));
    if (due > now + timeout) {
      std::this_thread::sleep_for(timeout);
      return false;
    }
    std::this_thread::sleep_until(due);
    last_time_s_ = *header.time_s;
    last_due_ = due;
    return true;
  }

  RecordingSet set_;
  std::vector<CaptureReader> captures_;
  SourceInfo info_;
  bool real_time_ = false, loop_ = false, running_ = false;
  std::size_t capture_ = 0;
  int frame_ = 0;
  std::optional<double> last_time_s_;
  Clock::time_point last_due_;
};

}  // namespace

std::unique_ptr<FrameSource> open_replay(Uri uri) { return std::make_unique<ReplaySource>(std::move(uri)); }

}  // namespace binrig
