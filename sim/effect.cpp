#include "sim/effect.h"

#include <algorithm>

#include "core/parallel.h"

namespace binrig {
namespace {

class StatelessRun : public Run {
 public:
  using Apply = std::function<void(Layers&, const Channels&, const FrameInstant&)>;
  explicit StatelessRun(Apply apply) : apply_(std::move(apply)) {}
  void apply(Layers& layers, const Channels& channels, const FrameInstant& instant) override {
    apply_(layers, channels, instant);
  }

 private:
  Apply apply_;
};

}  // namespace

bool Effect::is_neutral(const EffectInstance& instance) const {
  bool any = false;
  const EffectDeclaration& what = instance.own_declaration ? *instance.own_declaration : declaration;
  for (const ParameterSpec& parameter : what.parameters) {
    if (!parameter.neutral) continue;
    if (instance.value(parameter.name) != *parameter.neutral) return false;
    any = true;
  }
  return any;
}

std::unique_ptr<Run> stateless(std::function<void(Layers&, const Channels&, const FrameInstant&)> apply) {
  return std::make_unique<StatelessRun>(std::move(apply));
}

std::unique_ptr<Run> adding(const cv::Mat& error_mm) {
  return stateless([error_mm](Layers& layers, const Channels&, const FrameInstant&) {
    map_depth(layers, [&](int row) {
      return [error = error_mm.ptr<float>(row)](float z, int col) { return z + error[col]; };
    });
  });
}

void for_rows(cv::Size size, const std::function<void(int, int)>& body) {
  // Below this many pixels a thread costs more than it saves.
  constexpr int pixels_per_block = 100'000;
  const int blocks = std::clamp(size.area() / pixels_per_block, 1, std::min(jobs(), std::max(size.height, 1)));
  if (blocks == 1) return body(0, size.height);
  parallel_for(blocks, [&](int i) { body(size.height * i / blocks, size.height * (i + 1) / blocks); });
}

std::pair<float, float> valid_range(const cv::Mat& depth_mm, const cv::Mat& reason, int row, int col, int half) {
  float low = depth_mm.at<float>(row, col), high = low;
  for (int y = std::max(0, row - half); y <= std::min(depth_mm.rows - 1, row + half); ++y) {
    const float* z = depth_mm.ptr<float>(y);
    const std::uint8_t* r = reason.ptr<std::uint8_t>(y);
    for (int x = std::max(0, col - half); x <= std::min(depth_mm.cols - 1, col + half); ++x) {
      if (r[x] != 0) continue;
      low = std::min(low, z[x]);
      high = std::max(high, z[x]);
    }
  }
  return {low, high};
}

void OtherView::apply(Layers& layers, const Channels& nominal, const FrameInstant& instant) {
  seen_ = look(instant);
  if (!layers.ir.empty() && !seen_->ir.empty()) layers.ir = seen_->ir.clone();
  const cv::Mat &nominal_mm = nominal.depth_mm, &seen_mm = seen_->depth_mm;
  constexpr auto measured = static_cast<std::uint8_t>(Reason::measured);
  constexpr auto no_surface = static_cast<std::uint8_t>(Reason::no_surface);
  for_rows(seen_mm.size(), [&](int first, int last) {
    for (int row = first; row < last; ++row) {
      const float *before = nominal_mm.ptr<float>(row), *seen = seen_mm.ptr<float>(row);
      float* z = layers.depth_mm.ptr<float>(row);
      std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
      for (int col = 0; col < seen_mm.cols; ++col) {
        if (reason[col] == measured) {
          z[col] = seen[col] + (z[col] - before[col]);
          if (!(seen[col] > 0)) reason[col] = no_surface;
        } else if (reason[col] == no_surface && seen[col] > 0) {
          z[col] = seen[col];
          reason[col] = measured;
        }
      }
    }
  });
}

ParameterSpec disturbance_grid() {
  return {.name = "grid",
          .unit = "px",
          .lower = 4,
          .upper = 512,
          .typical_low = 8,
          .typical_high = 64,
          .initial = 32,
          .log_scaled = true,
          .meaning = "cell of the coarsest lattice of the disturbance; a half and a quarter of it are mixed in"};
}

ParameterSpec disturbance_share() {
  return {.name = "share",
          .unit = "1",
          .lower = 0,
          .upper = 1,
          .typical_low = 0.05,
          .typical_high = 1,
          .initial = 0.5,
          .meaning = "share of the disturbance's variance that is new in every frame"};
}

OptionSpec disturbance_weight() {
  return {"weight", "how the disturbance is interpolated between lattice points", "cubic", {"cubic", "quintic"}};
}

bool any_between(const Layers& layers, const cv::Mat& value, float low, float high) {
  for (int row = 0; row < value.rows; ++row) {
    const float* v = value.ptr<float>(row);
    const std::uint8_t* reason = layers.reason.ptr<std::uint8_t>(row);
    int near = 0, found = 0;
    for (int col = 0; col < value.cols; ++col) near |= (v[col] >= low) & (v[col] <= high);  // vectorised; mostly none is
    if (!near) continue;
    for (int col = 0; col < value.cols; ++col) found |= (v[col] >= low) & (v[col] <= high) & (reason[col] == 0);
    if (found) return true;
  }
  return false;
}

DisturbanceField disturbance_field(const EffectInstance& instance, const CaptureContext& context) {
  const auto weight = instance.options.find("weight");
  const bool quintic = weight != instance.options.end() && weight->second == "quintic";
  return DisturbanceField(context.camera.height, context.camera.width, instance.value("grid"), instance.value("share"),
                          quintic ? LatticeWeight::quintic : LatticeWeight::cubic, context.capture_draws());
}

const Effect* find_effect(const std::string& name) {
  for (const Effect* effect : all_effects()) {
    if (effect->declaration.name == name) return effect;
  }
  return nullptr;
}

const EffectCatalogue& effect_catalogue() {
  static const EffectCatalogue catalogue([] {
    std::vector<const EffectDeclaration*> declarations;
    for (const Effect* effect : all_effects()) declarations.push_back(&effect->declaration);
    return declarations;
  }());
  return catalogue;
}

}  // namespace binrig
