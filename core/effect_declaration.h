// What an effect is, without how it acts: the one declaration from which the command line's help, the checks of a model
// file, the bounds of every fit, the documentation and the diagnosis are made. How it acts is in sim/effect.h.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/channels.h"
#include "core/frame.h"

namespace binrig {

/// In the order in which they act. Inside a stage the order of the model file counts. What looks elsewhere (view) comes
/// first: errors of depth are those at the place that is seen.
enum class Stage {
  view,
  geometry,
  matching,
  signal_mask,
  amplitude,
  noise,
  spatial,
  quantise,
  temporal,
  device,
  storage
};
const char* stage_name(Stage stage);
std::optional<Stage> stage_from_name(const std::string& name);
std::vector<std::string> stage_names();

enum class ParameterKind {
  continuous,
  integer,  ///< values between whole numbers do not exist
  phase,    ///< rad, circular with period 2 pi
  chance,   ///< continuous: the share of frames that something happens to as a whole, or does not
};

struct ParameterSpec {
  std::string name;     ///< the field's term: amplitude, period, correlation_length
  std::string unit;     ///< "mm", "px", "rad", "s", "1/px", "deg", "1" for pure numbers
  double lower = 0, upper = 0;                  ///< accepted values, both ends included
  double typical_low = 0, typical_high = 0;     ///< magnitudes that real instruments show
  bool either_sign = false;                     ///< the typical range holds for -value, too
  std::optional<double> neutral;                ///< value at which the whole effect changes nothing
  double initial = 0;                           ///< where a fit starts and what an absent key means
  bool log_scaled = false;                      ///< natural scale of search and of intervals
  ParameterKind kind = ParameterKind::continuous;
  /// False where the effect's trace in the data does not move smoothly with the value (a comb's tooth, a shadow's
  /// side): each value tried then stands for itself.
  bool interpolate = true;
  std::string meaning;  ///< one clause
};

/// A key whose value is text (a file, an expression, a switch).
struct OptionSpec {
  std::string name, meaning, default_value;
  std::vector<std::string> choices;  ///< empty = free text
  bool is_file = false;              ///< a path, relative to the model file
};

/// What a recording must offer before the effect can show itself, or act at all.
struct Needs {
  bool baseline = false;  ///< the projector's place is known or fitted
  bool power_on = false;  ///< a series from power-on
  bool motion = false;    ///< poses differ between frames
  bool repeats = false;   ///< more than one frame of a target
  bool ir = false;        ///< an infra-red image, or the targets' reflectance
  std::vector<std::string> words() const;
};

struct EffectDeclaration {
  std::string name;        ///< exactly as in EFFECTS.md and the file's name
  std::string phenomenon;  ///< one sentence a user understands
  Stage stage = Stage::geometry;
  std::string formula;     ///< the forward model, in plain text
  std::string citation;
  std::string deviation;   ///< where we depart from the source, or ""
  std::vector<ParameterSpec> parameters;
  std::vector<OptionSpec> options;
  ChannelSet reads = static_cast<ChannelSet>(Channel::depth);
  int neighbourhood_px = 0;  ///< how far apart pixels may influence each other; -1 = the whole image
  std::optional<Reason> reason;  ///< the reason it gives, for effects that invalidate
  std::string amplitude;     ///< the parameter that says how strong it is
  bool stronger_is_larger = true;
  Needs needs;
  bool per_unit_map = false;  ///< `realisation: map`: draws a map that belongs to the unit
  bool per_capture_map = false;  ///< draws a map of depth errors anew in each capture, which stays through it
  bool may_clear = false;     ///< may turn an invalid pixel into a valid one
  bool user_defined = false;  ///< stage and parameters come from the model file (formula)
  std::string revealed_by;    ///< the capture that shows it best

  const ParameterSpec* parameter(const std::string& parameter_name) const;
  const OptionSpec* option(const std::string& option_name) const;
};

/// Weak, medium and strong: the 15, 50 and 85 % points of the amplitude parameter's typical range on a log scale
/// (counted from the neutral side, so that "strong" is the lower end where smaller is stronger).
enum class Strength { weak, medium, strong };
double strength_value(const EffectDeclaration& declaration, Strength strength);

/// All effects of this program, in the order of their names.
class EffectCatalogue {
 public:
  explicit EffectCatalogue(std::vector<const EffectDeclaration*> declarations);
  const std::vector<const EffectDeclaration*>& all() const { return declarations_; }
  const EffectDeclaration* find(const std::string& name) const;
  std::vector<std::string> names() const;

 private:
  std::vector<const EffectDeclaration*> declarations_;
};

}  // namespace binrig
