#include "sim/sensor.h"

#include <cmath>
#include <filesystem>
#include <limits>
#include <vector>

#include "core/error.h"
#include "core/wide.h"

namespace binrig {
namespace {

/// Why the capture cannot host the effect, in words, or "".
std::string unmet_need(const Needs& needs, const CaptureContext& context) {
  if (needs.baseline && context.focal_baseline() <= 0) {
    return "needs the baseline: the projector's place is unknown or straight above the camera";
  }
  if (needs.power_on && !context.power_on) return "needs a capture that begins with power-on";
  if (needs.motion && !context.motion) return "needs a capture in which something moves";
  if (needs.repeats && context.frames == 1) return "needs more than one frame";
  return "";
}

void add_noise_to_depth(Layers& layers) {
  map_depth(layers, [&](int row) {
    const float* noise = layers.noise_mm.ptr<float>(row);
    return [noise](float z, int col) { return z + noise[col]; };
  });
}

/// One row of the last step of the storage stage. A depth that would be stored as 0 cannot be kept: 0 means invalid
/// there. In loops of one width each, without branches: the compiler vectorises no others.
BINRIG_WIDE void store_row(float* z, std::uint8_t* reason, int cols, double depth_scale_mm, float* stored, int* lost) {
  const bool steps = depth_scale_mm > 0;
  const double per_mm = steps ? 1.0 / depth_scale_mm : 1.0;
  const float highest = static_cast<float>(steps ? 65536.0 * depth_scale_mm : std::numeric_limits<float>::max());
  constexpr int out_of_range = static_cast<int>(Reason::out_of_range);
  constexpr int unknown = static_cast<int>(Reason::unknown);
  // Depths that cannot be kept become 0 here; the clamp keeps the conversion to integers defined.
  for (int col = 0; col < cols; ++col) {
    const float positive = z[col] > 0.f ? z[col] : 0.f;
    stored[col] = positive < highest ? positive : 0.f;
  }
  if (steps)
    for (int col = 0; col < cols; ++col) {
      const int value = static_cast<int>(stored[col] * per_mm + 0.5);
      stored[col] = static_cast<float>((value <= 65535 ? value : 0) * depth_scale_mm);
    }
  for (int col = 0; col < cols; ++col) {
    const int why = z[col] == z[col] ? out_of_range : unknown;
    lost[col] = stored[col] == 0.f ? why : 0;
  }
  for (int col = 0; col < cols; ++col) {
    const auto why = static_cast<std::uint8_t>(lost[col]);
    reason[col] = reason[col] == 0 ? why : reason[col];
  }
  for (int col = 0; col < cols; ++col) lost[col] = reason[col];
  for (int col = 0; col < cols; ++col) z[col] = lost[col] == 0 ? stored[col] : 0.f;
}

/// The last step of the storage stage: what a 16-bit file of the scale holds.
void store(Layers& layers, double depth_scale_mm) {
  for_rows(layers.depth_mm.size(), [&](int first, int last) {
    const int cols = layers.depth_mm.cols;
    std::vector<float> stored(cols);
    std::vector<int> lost(cols);
    for (int row = first; row < last; ++row)
      store_row(layers.depth_mm.ptr<float>(row), layers.reason.ptr<std::uint8_t>(row), cols, depth_scale_mm,
                stored.data(), lost.data());
  });
}

cv::Mat ir_counts(const cv::Mat& relative) {
  cv::Mat counts;
  if (!relative.empty()) relative.convertTo(counts, CV_16U, 65535.0);  // saturates: the image clips, not the effects
  return counts;
}

}  // namespace

struct SensorRun::Impl {
  struct Step {
    Stage stage;
    CaptureContext context;
    std::unique_ptr<Run> run;
  };
  double depth_scale_mm = 0;
  std::vector<std::unique_ptr<Step>> steps;  // a Run may keep a reference to its context
  cv::Mat sigma_scale, noise_mm;             // memory that every frame begins anew with
  std::vector<std::pair<std::string, std::string>> inactive;
};

SensorRun::SensorRun(const SensorModel& model, const CaptureContext& context) : impl_(std::make_unique<Impl>()) {
  impl_->depth_scale_mm = context.depth_scale_mm;
  Violations violations;
  for (const EffectInstance& instance : model.effects) {
    const Effect* effect = find_effect(instance.effect);
    if (!effect) {
      violations.add(instance.where, instance.id, "there is no effect " + instance.effect + " in this program");
      continue;
    }
    if (effect->is_neutral(instance)) continue;
    const EffectDeclaration& declaration = instance.declaration(effect_catalogue());
    if (const std::string why = unmet_need(declaration.needs, context); !why.empty()) {
      // A camera that the model itself writes down is wrong for good; a recording merely lacks something.
      if (declaration.needs.baseline && context.focal_baseline() <= 0 && model.camera_from == Given::written) {
        violations.add(instance.where, instance.id, why + "; write projector: {x: ...} beside the camera");
      } else {
        impl_->inactive.emplace_back(instance.id, why);
      }
      continue;
    }
    auto step = std::make_unique<Impl::Step>();
    step->stage = declaration.stage;
    step->context = context;
    step->context.instance = instance.id;
    step->context.wanted = needed_channels(model, true);
    step->context.model_folder = std::filesystem::path(model.file).parent_path().string();
    try {
      step->run = effect->begin(instance, step->context);
    } catch (const Error& error) {
      if (error.violations().empty()) violations.add(instance.where, instance.id, error.what());
      violations.add_all(error.violations());
      continue;
    }
    impl_->steps.push_back(std::move(step));
  }
  violations.throw_if_any("the sensor model " + model.name + " does not fit this capture");
}

SensorRun::~SensorRun() = default;

Frame SensorRun::frame(const Channels& channels, const FrameInstant& instant) {
  Layers layers;
  layers.depth_mm = channels.depth_mm.clone();
  const cv::Size size = layers.depth_mm.size();
  impl_->sigma_scale.create(size, CV_32F);
  impl_->noise_mm.create(size, CV_32F);
  layers.sigma_scale = impl_->sigma_scale;
  layers.noise_mm = impl_->noise_mm;
  layers.sigma_scale.setTo(1);
  layers.noise_mm.setTo(0);
  layers.reason.create(size, CV_8U);
  for_rows(size, [&](int first, int last) {
    for (int row = first; row < last; ++row) {
      const float* z = layers.depth_mm.ptr<float>(row);
      std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
      for (int col = 0; col < size.width; ++col) reason[col] = z[col] > 0 ? 0 : 1;
    }
  });
  static_assert(static_cast<int>(Reason::measured) == 0 && static_cast<int>(Reason::no_surface) == 1);
  if (!channels.ir.empty()) layers.ir = channels.ir.clone();

  bool noise_added = false;
  const Channels* seen = &channels;
  for (const auto& step : impl_->steps) {
    if (!noise_added && step->stage > Stage::noise) {
      add_noise_to_depth(layers);
      noise_added = true;
    }
    const auto* other = dynamic_cast<const OtherView*>(step->run.get());
    step->run->apply(layers, other ? channels : *seen, instant);
    if (other) seen = &other->seen();
  }
  if (!noise_added) add_noise_to_depth(layers);
  store(layers, impl_->depth_scale_mm);

  Frame frame;
  frame.camera = channels.camera;
  frame.depth_mm = layers.depth_mm;
  frame.reason = layers.reason;
  frame.ir = ir_counts(layers.ir);
  frame.depth_scale_mm = impl_->depth_scale_mm;
  return frame;
}

ChannelSet SensorRun::needed_channels(const SensorModel& model, bool with_ir) {
  ChannelSet wanted = static_cast<ChannelSet>(Channel::depth);
  if (with_ir) wanted = wanted | Channel::ir;
  for (const EffectInstance& instance : model.effects) {
    const Effect* effect = find_effect(instance.effect);
    if (effect && !effect->is_neutral(instance)) wanted |= effect->channels_read(instance);
  }
  return wanted;
}

const std::vector<std::pair<std::string, std::string>>& SensorRun::inactive() const { return impl_->inactive; }

}  // namespace binrig
