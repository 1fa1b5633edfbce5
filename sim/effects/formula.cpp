// Formula: an effect of one's own, written in the model file and needing no C++.
//
//   - formula: {id: bow, stage: geometry, on: depth, expression: "a*r2", parameters: {a: {value: 0.1, unit: mm}}}
//
//   on: depth      z' = z + expression (mm)
//   on: disparity  d' = d + expression (px), z' = f B / d'
//   on: sigma      sigma' = sigma max(0, 1 + expression)
//   on: invalid    invalid (unknown) where expression > 0
//
// What an expression may use: z depth (mm), d disparity (px), x y r r2 image coordinates (half the width is 1; r2 = 1
// in the corners), u v pixel (px), theta incidence (rad), I infra-red intensity, e c distance (px) to the nearest depth
// edge and concave crease, t seconds since power-on (infinite in other captures), z0 reference distance (mm), n frame
// number; and its own parameters. A pixel for which it is not a finite number becomes invalid (unknown): a division by
// zero somewhere makes holes there and never a NaN.
#include <algorithm>
#include <array>
#include <set>

#include <muParser.h>
#include <omp.h>

#include "core/error.h"
#include "sim/effect.h"

namespace binrig::effects {
namespace {

constexpr std::array variable_names{"z", "d", "x", "y", "r", "r2", "u", "v", "theta", "I", "e", "c", "t", "z0", "n"};
enum Variable { z, d, x, y, r, r2, u, v, theta, I, e, c, t, z0, n, variable_count };
static_assert(variable_names.size() == variable_count);

enum class Target { depth, disparity, sigma, invalid };

std::string option(const EffectInstance& instance, const char* name) {
  const auto found = instance.options.find(name);
  return found == instance.options.end() ? std::string() : found->second;
}

Target target_of(const EffectInstance& instance) {
  const std::string on = option(instance, "on");
  return on == "disparity" ? Target::disparity
         : on == "sigma"   ? Target::sigma
         : on == "invalid" ? Target::invalid
                           : Target::depth;
}

[[noreturn]] void refuse(const EffectInstance& instance, const std::string& message) {
  throw Error("formula", {{.where = instance.where,
                           .key = instance.id + ".expression",
                           .value = option(instance, "expression"),
                           .message = message}});
}

/// The variables of the channels that the expression uses. Throws Error for everything that is wrong with it.
std::set<std::string> used_variables(const EffectInstance& instance) {
  mu::Parser parser;
  try {
    parser.SetExpr(option(instance, "expression"));
    std::set<std::string> used;
    std::vector<std::string> known(variable_names.begin(), variable_names.end());
    for (const auto& [name, value] : instance.values) known.push_back(name);
    for (const auto& [name, address] : parser.GetUsedVar()) {
      if (std::find(known.begin(), known.end(), name) == known.end()) {
        const std::string near = nearest_word(name, known);
        refuse(instance, "uses " + name + ", which is neither a channel nor one of its parameters" +
                             (near.empty() ? "" : ": did you mean " + near + "?"));
      }
      if (!instance.values.count(name)) used.insert(name);
    }
    return used;
  } catch (const mu::ParserError& error) {
    refuse(instance, "is not an expression: " + error.GetMsg());
  }
}

/// One expression over rows of pixels. A parser of its own for every thread.
class RowEvaluator {
 public:
  RowEvaluator(const EffectInstance& instance, int cols) : cols_(cols), result_(cols) {
    for (std::size_t i = 0; i < variable_count; ++i) {
      values_[i].assign(cols, 0.0);
      if (!instance.values.count(variable_names[i])) parser_.DefineVar(variable_names[i], values_[i].data());
    }
    for (const auto& [name, value] : instance.values) parser_.DefineConst(name, value.value);
    parser_.SetExpr(option(instance, "expression"));
  }
  std::vector<double>& operator[](Variable variable) { return values_[variable]; }
  void fill(Variable variable, double value) { std::fill(values_[variable].begin(), values_[variable].end(), value); }
  const std::vector<double>& evaluate() {
    // muParser would start threads of its own for every row; ours already share the rows out.
    const int threads = omp_get_max_threads();
    omp_set_num_threads(1);
    parser_.Eval(result_.data(), cols_);
    omp_set_num_threads(threads);
    return result_;
  }

 private:
  int cols_;
  mu::Parser parser_;
  std::array<std::vector<double>, variable_count> values_;
  std::vector<double> result_;
};

class Formula : public Run {
 public:
  Formula(const EffectInstance& instance, const CaptureContext& context)
      : instance_(instance), context_(context), image_(context.camera), target_(target_of(instance)) {
    used_ = used_variables(instance);
    for (std::size_t i = 0; i < variable_count; ++i) uses_[i] = used_.count(variable_names[i]) != 0;
    for (const auto& [name, value] : instance.values) {
      if (std::find(variable_names.begin(), variable_names.end(), name) != variable_names.end()) {
        refuse(instance, "has a parameter " + name + ", which is the name of a channel");
      }
    }
    if (target_ == Target::sigma && instance.own_declaration && instance.own_declaration->stage > Stage::amplitude) {
      refuse(instance, std::string("acts on sigma in stage ") + stage_name(instance.own_declaration->stage) +
                           ", after the noise has been drawn: use stage: amplitude");
    }
    if ((used_.count("d") || target_ == Target::disparity) && context.focal_baseline() <= 0) {
      refuse(instance, "needs the baseline, which is unknown");
    }
    try {
      RowEvaluator trial(instance, 1);
      const double value = trial.evaluate()[0];
      if (used_.empty() && !std::isfinite(value)) refuse(instance, "is " + number_text(value) + " everywhere");
    } catch (const mu::ParserError& error) {
      refuse(instance, "cannot be computed: " + error.GetMsg());
    }
  }

  void apply(Layers& layers, const Channels& channels, const FrameInstant& instant) override {
    for_rows(layers.depth_mm.size(), [&](int first, int last) {
      RowEvaluator row_of(instance_, layers.depth_mm.cols);
      row_of.fill(t, instant.since_power_on_s);
      row_of.fill(z0, context_.reference_distance_mm);
      row_of.fill(n, instant.number);
      for (int col = 0; col < layers.depth_mm.cols; ++col) {
        row_of[u][col] = col;
        row_of[x][col] = image_.x(col);
      }
      for (int row = first; row < last; ++row) {
        set_row(row_of, layers, channels, row);
        act(layers, row, row_of.evaluate());
      }
    });
  }

 private:
  bool uses(Variable variable) const { return uses_[variable]; }

  void set_row(RowEvaluator& values, const Layers& layers, const Channels& channels, int row) const {
    const int cols = layers.depth_mm.cols;
    const auto copy = [&](Variable variable, const cv::Mat& image) {
      if (uses(variable)) std::copy_n(image.ptr<float>(row), cols, values[variable].begin());
    };
    copy(z, layers.depth_mm);
    copy(I, channels.ir);
    copy(e, channels.edge_px);
    copy(c, channels.crease_px);
    if (uses(v)) values.fill(v, row);
    if (uses(y)) values.fill(y, image_.y(row));
    const auto compute = [&](Variable variable, const auto& of_column) {
      if (!uses(variable)) return;
      for (int col = 0; col < cols; ++col) values[variable][col] = of_column(col);
    };
    const double focal_baseline = context_.focal_baseline();
    const float* depth = layers.depth_mm.ptr<float>(row);
    compute(d, [&](int col) { return focal_baseline / depth[col]; });
    compute(r2, [&](int col) { return image_.r2(col, row); });
    compute(r, [&](int col) { return std::sqrt(image_.r2(col, row)); });
    compute(theta,
            [&](int col) { return std::acos(std::clamp(channels.cos_incidence.at<float>(row, col), 0.f, 1.f)); });
  }

  void act(Layers& layers, int row, const std::vector<double>& value) const {
    const float fb = static_cast<float>(context_.focal_baseline());
    float *depth = layers.depth_mm.ptr<float>(row), *sigma = layers.sigma_scale.ptr<float>(row);
    for (int col = 0; col < layers.depth_mm.cols; ++col) {
      if (!layers.valid(row, col)) continue;
      const float a = static_cast<float>(value[col]);
      if (!std::isfinite(a)) {
        layers.invalidate(row, col, Reason::unknown);
      } else if (target_ == Target::depth) {
        depth[col] += a;
      } else if (target_ == Target::disparity) {
        depth[col] = with_disparity_added(depth[col], a, fb);
      } else if (target_ == Target::sigma) {
        sigma[col] *= std::max(0.f, 1.f + a);
      } else if (a > 0) {
        layers.invalidate(row, col, Reason::unknown);
      }
    }
  }

  EffectInstance instance_;
  const CaptureContext& context_;
  ImageCoordinates image_;
  Target target_;
  std::set<std::string> used_;
  std::array<bool, variable_count> uses_{};
};

ChannelSet channels_of(const EffectInstance& instance) {
  ChannelSet wanted = static_cast<ChannelSet>(Channel::depth);
  const std::set<std::string> used = used_variables(instance);
  if (used.count("theta")) wanted = wanted | Channel::cos_incidence;
  if (used.count("I")) wanted = wanted | Channel::ir;
  if (used.count("e")) wanted = wanted | Channel::edge_distance;
  if (used.count("c")) wanted = wanted | Channel::crease_distance;
  return wanted;
}

}  // namespace

const Effect& formula() {
  static const Effect effect{
      {.name = "formula",
       .phenomenon = "Whatever you write: an expression with parameters of its own that are fitted like any other.",
       .stage = Stage::geometry,
       .formula = "z + expression, d + expression, sigma (1 + expression), or invalid where expression > 0",
       .citation = "your own",
       .deviation = "",
       .parameters = {},
       .options = {{"on", "what it acts on", "depth", {"depth", "disparity", "sigma", "invalid"}},
                   {"expression",
                    "over z d x y r r2 u v theta I e c t z0 n and its parameters, in muParser's notation",
                    "0",
                    {}}},
       .reads = static_cast<ChannelSet>(Channel::depth),
       .neighbourhood_px = 0,
       .amplitude = "",
       .user_defined = true,
       .revealed_by = "whatever capture makes the expression vary"},
      [](const EffectInstance& instance, const CaptureContext& context) -> std::unique_ptr<Run> {
        return std::make_unique<Formula>(instance, context);
      },
      channels_of};
  return effect;
}

}  // namespace binrig::effects
