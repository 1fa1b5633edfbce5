#include "bench/hidden_effects/recording.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "diagnose/hypotheses.h"
#include "sim/effect.h"

namespace binrig::hidden {
namespace {

constexpr double pi = std::numbers::pi;
constexpr ChannelSet everything = Channel::depth | Channel::normal | Channel::cos_incidence | Channel::projector_gap |
                                  Channel::diffuse | Channel::specular | Channel::ir | Channel::edge_distance |
                                  Channel::crease_distance;
/// Amplitudes of the outsiders: weak .. strong are points of these ranges, as for the catalogue. Noise has two modes
/// where they are further apart than its other part is wide (0.39 mm): below, the instrument's filters make it normal.
const std::map<std::string, std::pair<double, double>> outside_ranges{
    {"step_across_a_line", {0.1, 1}}, {"spiral", {0.05, 0.5}},
    {"checkerboard", {0.1, 1}},       {"moire", {0.05, 0.5}},
    {"corner_droop", {0.2, 2}},       {"bimodal_noise", {0.4, 2.4}},
    {"ring_of_holes", {0.05, 0.5}},   {"noise_towards_the_bottom", {0.1, 1}}};

double between(const ParameterSpec& spec, double share) {
  const double low = spec.typical_low, high = spec.typical_high;
  const double value = low > 0 && high > 5 * low ? low * std::pow(high / low, share) : low + (high - low) * share;
  return spec.kind == ParameterKind::integer ? std::round(value) : value;
}

cv::Mat stored(const Shot& shot, double step) {
  cv::Mat depth(shot.z.size(), CV_32F, cv::Scalar(0));
  for (int v = 0; v < shot.z.rows; ++v)
    for (int u = 0; u < shot.z.cols; ++u)
      if (!shot.hole(v, u) && shot.z(v, u) > 0)
        depth.at<float>(v, u) = static_cast<float>(std::min(65535.0, std::round(shot.z(v, u) / step)) * step);
  return depth;
}

/// An effect that acts on frames.
struct Part {
  std::string name;
  Values values;
  const Injection* injection;
};

void in_order_of_stages(std::vector<Part>& parts) {
  std::stable_sort(parts.begin(), parts.end(),
                   [](const Part& a, const Part& b) { return a.injection->stage < b.injection->stage; });
}

/// One capture of a set, frame by frame.
class Recorder {
 public:
  Recorder(const SceneForwardModel& forward, const SensorModel& model, const RecordingSet& set, int capture,
           const Offset& offset, std::uint64_t seed, const std::vector<Part>& parts)
      : forward_(forward),
        model_(model),
        info_(forward.captures()[capture]),
        reader_(set.capture(info_.key())),
        parts_(parts) {
    const Frame first = reader_.header(0);
    stand_.forward = &forward;
    stand_.model = &model;
    stand_.capture = capture;
    stand_.frames = info_.frames;
    stand_.offset = offset;
    stand_.camera = first.camera;
    if (const auto projector = set.info().sensor.projector())
      stand_.focal_baseline = stand_.camera.fx * std::abs(projector->x());
    stand_.z0 = forward.reference_distance_mm(model);
    stand_.power_on = info_.power_on;
    const auto last = reader_.header(info_.frames - 1);
    stand_.moves = first.objects && !first.objects->empty() && last.objects && !last.objects->empty() &&
                   !first.objects->front().X_CO.isApprox(last.objects->front().X_CO, 1e-12);
    stand_.unit = model.unit_seed;
    stand_.seed = mix_keys(seed, hash_text(info_.key()));
    start_s_ = first.time_s.value_or(0);
    for (const Part& part : parts_) {
      stand_.name = part.name;
      acts_.push_back(part.injection->begin(part.values, stand_));
    }
  }

  const CaptureReader& reader() const { return reader_; }

  /// Frame i with all parts on top of `before`: depth in mm, 0 = none; empty: what a perfect instrument sees.
  Frame frame(int i, const cv::Mat& before = {}) {
    const Frame header = reader_.header(i);
    const ImageCoordinates image(stand_.camera);
    Shot shot;
    shot.number = i;
    shot.time_s = header.time_s.value_or(0) - start_s_;
    shot.since_power_on_s = info_.power_on ? shot.time_s : std::numeric_limits<double>::infinity();
    shot.seen = forward_.perfect(stand_.capture, i, stand_.offset, everything, model_);
    shot.cx = image.cx, shot.cy = image.cy, shot.per_px = image.scale, shot.corner = image.corner;
    shot.z = before.empty() ? shot.seen->depth_mm.clone() : before.clone();
    shot.hole = cv::Mat_<uchar>::zeros(shot.z.size());
    for (int v = 0; v < shot.z.rows; ++v)
      for (int u = 0; u < shot.z.cols; ++u) shot.hole(v, u) = shot.z(v, u) <= 0;
    shot.scale = cv::Mat_<float>(shot.z.size(), 1.f);
    shot.noise = cv::Mat_<float>::zeros(shot.z.size());
    bool noisy = false;
    for (std::size_t k = 0; k < parts_.size(); ++k) {
      if (!noisy && parts_[k].injection->stage > Stage::noise) shot.z += shot.noise, noisy = true;
      Dice dice(RandomStream(stand_.seed).child(parts_[k].name).child(static_cast<std::uint64_t>(i)));
      acts_[k](shot, dice);
    }
    if (!noisy) shot.z += shot.noise;
    Frame frame = header;
    frame.depth_mm = stored(shot, header.depth_scale_mm);
    frame.reason = cv::Mat(frame.depth_mm.size(), CV_8U, cv::Scalar(0));
    frame.reason.setTo(static_cast<int>(Reason::unknown), frame.depth_mm <= 0);
    frame.sequence = i;
    return frame;
  }

 private:
  const SceneForwardModel& forward_;
  const SensorModel& model_;
  const CaptureInfo& info_;
  const CaptureReader reader_;
  const std::vector<Part>& parts_;
  Stand stand_;
  double start_s_ = 0;
  std::vector<Act> acts_;
};

}  // namespace

std::shared_ptr<const Channels> Stand::look(int frame, double time_s, double focal_factor, const Vector3* light,
                                            ChannelSet wanted) const {
  Offset lens = offset;
  lens.focal_px += (focal_factor - 1) * (camera.fx + offset.focal_px);
  RenderRequest request = forward->request_for(capture, frame, lens, *model);
  if (light) request.projector_xyz_mm = *light;
  request.wanted = wanted & everything;
  return forward->renderer().render(forward->scene_at(capture, time_s, offset), request);
}

const Injection& injection(const std::string& name) {
  for (const auto* table : {&depth_injections(), &signal_injections(), &outside_injections()})
    if (const auto found = table->find(name); found != table->end()) return found->second;
  throw Error("no effect " + name + " can be hidden");
}

std::vector<std::string> outsider_names() {
  std::vector<std::string> names;
  for (const auto& [name, unused] : outside_injections()) names.push_back(name);
  return names;
}

HiddenEffect draw_hidden(const std::string& name, Strength strength, const RandomStream& stream) {
  Dice dice(stream.child(name));
  HiddenEffect hidden{name, {}};
  if (const auto range = outside_ranges.find(name); range != outside_ranges.end()) {
    const double share = strength == Strength::weak ? 0.15 : strength == Strength::medium ? 0.5 : 0.85;
    const auto [low, high] = range->second;
    const bool variance = injection(name).stage != Stage::geometry;
    hidden.values = {{"amplitude", low * std::pow(high / low, share) * (variance ? 1 : dice.sign())},
                     {"angle", dice.uniform(-pi, pi)},
                     {"place", dice.uniform(-0.3, 0.3)},
                     {"phase", dice.uniform(-pi, pi)},
                     {"side", std::floor(dice.uniform(6, 15))}};
    return hidden;
  }
  const EffectDeclaration* effect = effect_catalogue().find(name);
  if (!effect) throw Error("no effect " + name + " can be hidden");
  for (const ParameterSpec& spec : effect->parameters) {
    double& value = hidden.values[spec.name];
    if (spec.name == effect->amplitude) {
      value = strength_value(*effect, strength);
      // The search tries just these values; of a step, no other one is near.
      if (is_step(*effect, spec)) value *= std::exp(dice.uniform(-0.3, 0.3));
    } else {
      value = spec.kind == ParameterKind::phase ? dice.uniform(-pi, pi) : between(spec, dice.uniform(0.15, 0.85));
    }
    if (spec.either_sign) value *= dice.sign();
  }
  if (name == "depth_warp")  // five terms of one kind: those besides the amplitude are at most half of it
    for (auto& [term, value] : hidden.values)
      if (term != effect->amplitude) value = dice.uniform(-0.5, 0.5) * strength_value(*effect, strength);
  for (const char* vertical : {"y", "centre_y"})
    if (hidden.values.count(vertical)) hidden.values[vertical] *= 0.75;  // inside the image
  return hidden;
}

bench::Recording record(const SceneForwardModel& forward, const SensorModel& instrument,
                        const std::vector<HiddenEffect>& hidden, const std::vector<Offset>& offsets,
                        std::uint64_t seed) {
  std::vector<Part> parts;
  for (const EffectInstance& effect : instrument.effects) {
    Part part{effect.effect, {}, &injection(effect.effect)};
    for (const auto& [name, value] : effect.values) part.values[name] = value.value;
    parts.push_back(part);
  }
  for (const HiddenEffect& effect : hidden) {
    // A hidden effect that the base has, too, replaces it; others come after the base's of the same stage.
    std::erase_if(parts, [&](const Part& p) { return p.name == effect.name; });
    parts.push_back({effect.name, effect.values, &injection(effect.name)});
  }
  in_order_of_stages(parts);
  const RecordingSet set = RecordingSet::open(forward.set().path);
  bench::Recording recording(forward.captures().size());
  parallel_for(static_cast<int>(recording.size()), [&](int c) {
    Recorder recorder(forward, instrument, set, c, offsets[c], seed, parts);
    for (int i = 0; i < forward.captures()[c].frames; ++i) recording[c].push_back(recorder.frame(i));
  });
  return recording;
}

bench::Recording record_on_top(const SceneForwardModel& forward, const SensorModel& model,
                               const std::vector<HiddenEffect>& hidden, std::uint64_t seed) {
  std::vector<Part> parts;
  for (const HiddenEffect& effect : hidden) {
    const Injection& how = injection(effect.name);
    if (how.stage == Stage::view || how.stage == Stage::amplitude)
      throw Error(effect.name + " acts on what the sensor sees, and that is over when a frame has been recorded");
    parts.push_back({effect.name, effect.values, &how});
  }
  in_order_of_stages(parts);
  const RecordingSet set = RecordingSet::open(forward.set().path);
  bench::Recording recording(forward.captures().size());
  parallel_for(static_cast<int>(recording.size()), [&](int c) {
    Recorder recorder(forward, model, set, c, {}, seed, parts);
    for (int i = 0; i < forward.captures()[c].frames; ++i)
      recording[c].push_back(recorder.frame(i, recorder.reader().frame(i).depth_mm));
  });
  return recording;
}

}  // namespace binrig::hidden
