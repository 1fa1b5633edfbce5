#include "diagnose/experiment.h"

#include <time.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <limits>
#include <mutex>
#include <numeric>
#include <tuple>

#include <fmt/format.h>

#include "core/error.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/random.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr float unknown = std::numeric_limits<float>::quiet_NaN();

/// Everything of the set that a simulation depends on: what was captured, from where, of what.
std::uint64_t scene_key(const SetInfo& set) {
  namespace fs = std::filesystem;
  std::uint64_t key = hash_text("scene");
  const auto mix = [&](const fs::path& path) {
    std::error_code failed;
    if (fs::is_regular_file(path, failed)) key = mix_keys(key, file_key(path.string()));
  };
  mix(fs::path(set.path) / "recording.json");
  mix(fs::path(set.path) / "camera.json");
  for (const auto& capture : set.captures) {
    mix(fs::path(set.path) / capture.folder() / "scene_camera.json");
    mix(fs::path(set.path) / capture.folder() / "scene_gt.json");
  }
  std::vector<fs::path> models;
  std::error_code failed;
  for (const auto& item : fs::directory_iterator(fs::path(set.path) / "models", failed)) models.push_back(item.path());
  std::sort(models.begin(), models.end());
  for (const auto& path : models) mix(path);
  return key;
}

/// What of a model decides its simulations; names and provenance do not.
std::uint64_t model_key(const SensorModel& model, const EffectCatalogue& catalogue) {
  SensorModel plain = model;
  plain.name = "model";
  plain.description.clear();
  plain.file.clear();
  std::uint64_t files = 0;
  for (auto& effect : plain.effects) {
    effect.provenance.clear();
    effect.where.clear();
    for (auto& [name, value] : effect.values) {
      value.provenance.clear();
      value.ci95.reset();
    }
    for (const auto& option : effect.declaration(catalogue).options) {
      const auto given = effect.options.find(option.name);
      if (!option.is_file || given == effect.options.end() || given->second.empty()) continue;
      files = mix_keys(files, file_key((std::filesystem::path(model.file).parent_path() / given->second).string()));
    }
  }
  return mix_keys(hash_text(sensor_model_yaml(plain, catalogue)), files);
}

std::uint64_t offset_key(const Offset& offset) {
  std::uint64_t key = hash_text("offset");
  const auto mix = [&](double value) {
    key = mix_keys(key, hash_text(std::string_view(reinterpret_cast<const char*>(&value), sizeof value)));
  };
  for (int i = 0; i < 6; ++i) mix(offset.pose[i]);
  mix(offset.focal_px), mix(offset.cx_px), mix(offset.cy_px);
  return key;
}

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

int shortened_frames(int most_frames, bool shorten_series, const CaptureInfo& capture, int frames) {
  const bool shorten = most_frames > 0 && (shorten_series || !capture.power_on);
  return shorten ? std::min(frames, most_frames) : frames;
}

}  // namespace

const Block* Layout::find(int capture, const std::string& segment_name) const {
  for (const auto& block : blocks)
    if (block.capture == capture && segments()[block.segment].name == segment_name) return &block;
  return nullptr;
}

std::vector<int> captures_that_differ(const Layout& layout, const StatVector& a, const StatVector& b) {
  std::vector<int> captures;
  for (const Block& block : layout.blocks) {
    if (!captures.empty() && captures.back() == block.capture) continue;
    for (int i = block.offset; i < block.offset + block.size; ++i)
      if (a[i] != b[i] && !(std::isnan(a[i]) && std::isnan(b[i]))) {
        captures.push_back(block.capture);
        break;
      }
  }
  return captures;
}

void fill_unknown(const Layout& layout, std::vector<StatVector>& simulations, bool by_block) {
  for (const Block& block : layout.blocks) {
    double all = 0, known = 0;
    const auto fill = [&](int i, float value) {
      for (StatVector& one : simulations)
        if (std::isnan(one[i])) one[i] = value;
    };
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      float sum = 0;
      int count = 0;
      for (const StatVector& one : simulations)
        if (!std::isnan(one[i])) sum += one[i], ++count;
      if (count == 0) continue;
      all += sum, known += count;
      if (count < static_cast<int>(simulations.size())) fill(i, sum / count);
    }
    if (by_block && block.rows > 1 && known > 0)
      for (int i = block.offset; i < block.offset + block.size; ++i) fill(i, static_cast<float>(all / known));
  }
}

Experiment::Experiment(const ForwardModel& forward, const SensorModel& model, SimulationCache& cache)
    : forward_(forward), base_(model), cache_(cache), set_key_(scene_key(forward.set())) {
  const auto& captures = forward.captures();
  if (captures.empty()) throw Error("The recording set has no capture that can be simulated");
  layout_.captures = static_cast<int>(captures.size());
  contexts_.resize(captures.size());
  nominal_.resize(captures.size());
  regions_.resize(captures.size());
  parallel_for(layout_.captures, [&](int c) {
    nominal_[c] = forward.perfect(c, 0, Offset{}, statistics_channels(), model);
    StatisticContext& context = contexts_[c];
    context.capture = captures[c];
    context.frames = captures[c].frames;
    context.camera = nominal_[c]->camera;
    const auto projector =
        model.projector_known ? std::optional<Vector3>(model.projector_xyz_mm) : forward.set().sensor.projector();
    if (projector) context.focal_baseline = context.camera.fx * std::abs(projector->x());
    context.motion =
        context.frames > 1 &&
        forward.perfect(c, context.frames - 1, Offset{}, statistics_channels(), model).get() != nominal_[c].get();
    context.valid_region = forward.region(c);
    regions_[c] = std::make_shared<CaptureRegions>(*nominal_[c], context);
  });
  for (int c = 0; c < layout_.captures; ++c) {
    if (const cv::Mat& region = contexts_[c].valid_region; !region.empty()) {  // statistics are kept under this key
      CV_Assert(region.isContinuous() && region.type() == CV_8U);
      set_key_ = hash_text({reinterpret_cast<const char*>(region.data), region.total()}, mix_keys(set_key_, c));
    }
    layout_.train.push_back(captures[c].split == "train");
    const auto empty = CaptureStatistics(contexts_[c]).finish();
    for (int s = 0; s < static_cast<int>(empty.size()); ++s) {
      if (empty[s].value.empty()) continue;
      Block block{c,
                  s,
                  layout_.size,
                  static_cast<int>(empty[s].value.size()),
                  empty[s].rows,
                  empty[s].cols,
                  layout_.train.back()};
      layout_.size += block.size;
      layout_.blocks.push_back(block);
    }
  }
}

Experiment::~Experiment() {
  for (const auto& [what, cost] : costs_)
    fmt::print(stderr, "{:<40} {:7} captures {:8} frames {:7.1f} s of CPU\n", what, cost.captures, cost.frames,
               cost.cpu_s);
}

bool Experiment::repeats() const {
  return std::any_of(captures().begin(), captures().end(), [](const CaptureInfo& c) { return c.frames > 1; });
}

std::shared_ptr<const Channels> Experiment::nominal_at(int capture, int frame) const {
  if (!contexts_[capture].motion || frame == 0) return nominal_[capture];
  return forward_.perfect(capture, frame, Offset{}, statistics_channels(), base_);
}

void Experiment::put(int capture, const std::vector<RawStatistic>& raw, StatVector& vector) const {
  for (const auto& block : layout_.blocks) {
    if (block.capture != capture) continue;
    const auto& segment_raw = raw[block.segment];
    const auto& declaration = segments()[block.segment];
    if (static_cast<int>(segment_raw.value.size()) != block.size) continue;  // too few frames for this segment
    for (int i = 0; i < block.size; ++i)
      vector[block.offset + i] = segment_raw.weight[i] > 0
                                     ? declaration.stabilise(segment_raw.value[i], segment_raw.weight[i], i, block.size)
                                     : unknown;
  }
}

Measurement Experiment::measure(const FrameReader& reader, std::vector<std::string>& unreadable,
                                const std::vector<int>& shortened) const {
  Measurement measured;
  measured.all.assign(layout_.size, unknown);
  for (const int most : shortened)
    for (const bool series : {false, true}) measured.few[{most, series}].assign(layout_.size, unknown);
  std::mutex guard;
  parallel_for(layout_.captures, [&](int c) {
    struct Count {
      StatVector* vector;
      int frames;
      std::unique_ptr<CaptureStatistics> statistics;
    };
    std::vector<Count> counts;
    const auto begin = [&](StatVector& vector, int frames) {
      StatisticContext context = contexts_[c];
      context.frames = frames;
      counts.push_back({&vector, frames, std::make_unique<CaptureStatistics>(context)});
    };
    begin(measured.all, contexts_[c].frames);
    for (auto& [kind, vector] : measured.few)
      begin(vector, shortened_frames(kind.first, kind.second, captures()[c], contexts_[c].frames));
    for (int i = 0; i < contexts_[c].frames; ++i) {
      try {
        const auto channels = nominal_at(c, i);
        const Frame frame = reader(c, i);
        for (Count& count : counts)
          if (i < count.frames) count.statistics->add(frame, channels, channels == nominal_[c] ? regions_[c] : nullptr);
      } catch (const Error& error) {
        const std::lock_guard lock(guard);
        unreadable.push_back(error.what());
      }
    }
    for (Count& count : counts) put(c, count.statistics->finish(), *count.vector);
  });
  return measured;
}

void Experiment::read_simulation(SimulationRequest request, int frames, const SeenAt& seen, StatVector& vector) const {
  const int c = request.capture;
  StatisticContext context = contexts_[c];
  request.frames = context.frames = frames;
  CaptureStatistics statistics(context);
  forward_.simulate(request, [&](const Frame& frame, int number) {
    const auto channels = seen(number);
    statistics.add(frame, channels, channels == nominal_[c] ? regions_[c] : nullptr);
  });
  ++simulated_;
  put(c, statistics.finish(), vector);
}

void Experiment::simulate_capture(const Trial& trial, int c, StatVector& vector) const {
  // Nobody knows the maps of the unit that was measured: every simulated recording is one of another unit.
  SensorModel unit = trial.model;
  unit.unit_seed = mix_keys(unit.unit_seed, trial.seed);
  SimulationRequest request;
  request.capture = c;
  request.model = &unit;
  if (!trial.offsets.empty()) request.offset = trial.offsets[c];
  request.seed = trial.seed;
  const int frames = shortened_frames(trial.most_frames, trial.shorten_series, captures()[c], contexts_[c].frames);
  read_simulation(
      request, frames, [&](int number) { return nominal_at(c, number); }, vector);
}

StatVector Experiment::elsewhere(const SensorModel& model, int c, const Offset& where, std::uint64_t seed,
                                 int frames) const {
  SimulationRequest request;
  request.capture = c;
  request.model = &model;
  request.offset = where;
  request.seed = seed;
  StatVector result(layout_.size, unknown);
  const auto seen = [&](int number) { return forward_.perfect(c, number, where, statistics_channels(), base_); };
  read_simulation(request, std::min(frames, contexts_[c].frames), seen, result);
  return result;
}

void Experiment::account(const std::string& what, const Trial& trial, int c, double cpu_s) const {
  const std::lock_guard lock(costs_guard_);
  Cost& cost = costs_[what];
  ++cost.captures;
  cost.frames += shortened_frames(trial.most_frames, trial.shorten_series, captures()[c], contexts_[c].frames);
  cost.cpu_s += cpu_s;
}

std::vector<StatVector> Experiment::simulate(const std::vector<Trial>& trials, const std::string& what,
                                             bool shared) const {
  const int count = static_cast<int>(trials.size());
  std::vector<StatVector> results(count);
  std::vector<std::uint64_t> keys(count);
  std::vector<int> missing;
  const bool kept_on_disk = shared || !cache_.only_shared();
  for (int t = 0; t < count; ++t) {
    if (!kept_on_disk) {
      results[t].assign(layout_.size, unknown);
      missing.push_back(t);
      continue;
    }
    keys[t] = mix_keys(mix_keys(program_key(), set_key_), model_key(trials[t].model, forward_.catalogue()));
    keys[t] =
        mix_keys(keys[t], mix_keys(trials[t].seed, static_cast<std::uint64_t>(trials[t].part) +
                                                       16u * trials[t].most_frames + 8u * trials[t].shorten_series));
    for (const auto& offset : trials[t].offsets) keys[t] = mix_keys(keys[t], offset_key(offset));
    for (const int c : trials[t].only) keys[t] = mix_keys(keys[t], static_cast<std::uint64_t>(c) + 1);
    if (auto kept = cache_.get(keys[t]); kept && static_cast<int>(kept->size()) == layout_.size) {
      results[t] = std::move(*kept);
    } else {
      results[t].assign(layout_.size, unknown);
      missing.push_back(t);
    }
  }
  if (missing.empty()) return results;

  // Captures outside, trials inside, sorted by offset and seed: the perfect channels of one view and the draws of one
  // stream serve many trials.
  std::sort(missing.begin(), missing.end(), [&](int a, int b) {
    const auto key = [&](int t) { return trials[t].offsets.empty() ? 0 : offset_key(trials[t].offsets[0]); };
    return std::tuple(key(a), trials[a].seed, a) < std::tuple(key(b), trials[b].seed, b);
  });
  std::vector<std::pair<int, int>> tasks;  // capture, first of a chunk of trials
  std::vector<int> order(layout_.captures);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return captures()[a].frames > captures()[b].frames; });
  // Short enough that few captures, too, keep all threads busy.
  const int chunk = std::clamp(static_cast<int>(missing.size()) * layout_.captures / (4 * jobs()), 1, 16);
  for (int c : order)
    for (int first = 0; first < static_cast<int>(missing.size()); first += chunk) tasks.emplace_back(c, first);
  Progress bar(what.empty() ? "simulating" : what, static_cast<std::int64_t>(tasks.size()));
  parallel_for(static_cast<int>(tasks.size()), [&](int k) {
    const auto [c, first] = tasks[k];
    for (int i = first; i < std::min<int>(first + chunk, static_cast<int>(missing.size())); ++i) {
      const Trial& trial = trials[missing[i]];
      if (trial.part == Part::train && !layout_.train[c]) continue;
      if (trial.part == Part::test && layout_.train[c]) continue;
      if (!trial.only.empty() && std::find(trial.only.begin(), trial.only.end(), c) == trial.only.end()) continue;
      const double began = tracing() ? thread_seconds() : 0;
      simulate_capture(trial, c, results[missing[i]]);  // captures fill different parts of the vector
      if (tracing()) account(what, trial, c, thread_seconds() - began);
    }
    bar.advance();
  });
  if (!kept_on_disk) return results;
  for (int t : missing) cache_.put(keys[t], results[t]);
  return results;
}

}  // namespace binrig
