// Effects that draw a map which belongs to the unit: nobody knows the map, but whatever it is, it is the same in all
// captures. What train captures show of it must then return in the captures held out.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "diagnose/hypotheses.h"
#include "diagnose/rung.h"

namespace binrig {

/// What is left of a change (whitened, all captures) once nuisances have taken of it what they take of a measurement,
/// compressed like the latter's.
Whitened left_of(const Metric& train, const Metric& test, const Whitened& change);
/// What is left of recordings in which nothing is missing (Rung::nulls, the first two dozen), all captures.
std::vector<Whitened> left_of_nulls(const Rung& rung);

/// What an unknown map, common to all captures, explains of a residual.
///
/// Model: residual of cell i in capture c = l_c m_i + noise, m_i ~ N(0, a^2) independently. The loadings l_c are
/// learned from simulated units (leading eigenvector of the captures' second moments), the noise from the rung's nulls,
/// the strength a from train (empirical Bayes). A map that is smooth explains more than independent cells know of: the
/// gain is a lower bound.
class UnitMap {
 public:
  struct Gain {
    double train = 0;  ///< twice the logarithm of the marginal likelihood's ratio, times the noise's mean square
    double test = 0;   ///< of chi, by the map estimated on train
  };

  /// `without`: simulations of the rung's model (trials_of with it); `with`: of the model with the effect, same trials.
  UnitMap(const Layout& layout, const Rung& rung, const std::vector<StatVector>& without,
          const std::vector<StatVector>& with);
  /// Simulations to give to the constructor: a few units, all captures, targets where the rung has them.
  /// `frames`: of each capture, 0 = all. How often a pixel is a hole shows in a statistic that depends on their number.
  /// `count`: of units.
  static constexpr int few_units = 4;
  static std::vector<Trial> trials_of(const Rung& rung, const SensorModel& model, std::uint64_t seed, int frames = 2,
                                      int count = few_units);

  /// What units change, whitened, from the same simulations.
  static std::vector<Whitened> changes(const Rung& rung, const std::vector<StatVector>& without,
                                       const std::vector<StatVector>& with);

  /// `train`, `test`: Explained::rest of either part, whitened (dimensionless). `only_segment`: what of the gain is in
  /// that; empty = all.
  Gain gain(const Whitened& train, const Whitened& test, const std::string& only_segment = "") const;

  /// Bands that vary along rows or along columns of the image.
  enum Direction { rows, columns };
  /// Mean squares by ring of those cosines that vary along one direction alone, and of all; where a ring has none of
  /// the former, these stand for them.
  struct Banded {
    std::vector<double> varying, all;
  };
  /// Mean squares of a map's discrete cosine transform in rings of frequency: nearly independent, if the map is a
  /// stationary random one. What does not close at the image's border leaks little of all, but much of what there is in
  /// cosines that vary along one direction alone: where these are looked at, the map is tapered along it.
  struct Spectrum {
    std::vector<double> power;
    std::array<Banded, 2> tapered;  ///< by Direction
    double kurtosis = 3;            ///< of the map's values
    double least_kurtosis = 3;      ///< over the units it is a mean of: that of few independent patches scatters,
    double kurtosis_scatter = 0;    ///< and so does its logarithm
  };
  /// How the map estimated from a residual is matched by the spectrum of simulated units.
  struct Match {
    double log_scale = 0;       ///< logarithm of its power over theirs, the most likely one
    double log_likelihood = 0;  ///< at that (Whittle)
    std::vector<double> slope;  ///< by ring, of log(expected power) with log_scale; 0 where a ring does not count
    double misfit = 0;  ///< what rings are away from it: chi-square of at most as many degrees of freedom as rings
  };
  /// The segment in which an unknown map explains most of a residual (all captures); none if it explains nothing.
  std::optional<int> strongest(const Whitened& rest) const;
  /// Of what units change, whichever it was learned from; nuisances take of it what they take of a measurement.
  /// `segment`: of `strongest`. Kurtosis and power are means over the units. Power is the cross-spectrum of two maps,
  /// each by half of the captures: noise that a map lets come out otherwise (by a step of quantisation, a hole) is no
  /// part of it.
  Spectrum spectrum_of_units(int segment, const std::vector<Whitened>& change) const;
  /// `rest`: Explained::rest, all captures; `units`: of spectrum_of_units in the same segment. Rings that have less
  /// than a thousandth of the strongest one's power count for nothing: what leaks into them from the border is known
  /// badly.
  Match match(int segment, const Whitened& rest, const Spectrum& units) const;
  /// Number of units that it was learned from.
  double learned_from() const { return units_; }
  /// How many cosines each ring counts for: not for more than 200, since what is expected of a ring is known to a tenth
  /// at best. Units are few, and with a map in it noise is not quite what it was.
  std::vector<double> modes(int segment) const;

  /// Is the map estimated from a residual (all captures) like those of simulated units, by the distribution of its
  /// values and by its spectrum, whatever its strength? A step or a wave is no random map, a spot is no scatter of dead
  /// pixels, rings or a spiral have a scale of their own, and bands (has_bands, too) stand out among the cosines of the
  /// tapered map that vary along rows or columns alone, by more than 8 standard deviations of their squares' sum. Where
  /// it was learned from eight units or more, values more even than theirs (a smaller kurtosis, noise allowed for; in
  /// standard deviations of its logarithm over the units, squared) count against it together with the rings' misfit.
  bool looks_random(const Whitened& rest) const;
  /// Do bands stand out in it, tapered, among the other cosines of their rings, so that it is no random map whatever
  /// the texture? Not asked of rings with fewer than eight others.
  bool has_bands(const Whitened& rest) const;

 private:
  struct Loading {
    int offset;  // of the capture's block
    bool train;
    double value;
  };
  struct Segment {
    std::string name;
    int cells = 0, cols = 0;
    std::vector<Loading> loadings;
    double noise = 1;         // mean square
    Spectrum noise_spectrum;  // of a map where there is none
    Spectrum spectrum;
  };
  /// Estimates of a map, cell by cell; 0 where nothing is known.
  std::vector<double> map_of(const Segment& segment, const Whitened& rest) const;
  /// The same by every other capture each, so that what is new in each capture is not common to the two; by all where
  /// one of the two knows nothing.
  std::array<std::vector<double>, 2> halves_of(const Segment& segment, const Whitened& rest) const;
  /// What chance adds to the sum of the squares of map_of.
  double noise_in_map(const Segment& segment, const Whitened& rest) const;
  /// Sets the cells of which the captures that count (of their Loading) know something.
  template <typename Counts>
  void estimate(const Segment& segment, const Whitened& rest, const Counts& counts, std::vector<double>& map) const;
  /// Sums over the captures that count (of their Loading) of loading times residual and of loading squared, for one
  /// cell.
  template <typename Counts>
  void sums(const Segment& segment, int cell, const Whitened& rest, const Counts& counts, double& b, double& g) const;

  double units_ = 0;  // it was learned from
  std::vector<float> spread_;
  Metric train_, test_;
  std::vector<Segment> segments_;
};

/// Parameters of an effect that draws a map, by what the map looks like: its typical unit moves nothing that could be
/// fitted.
struct UnitMapFit {
  std::map<std::string, double> values;
  UnitMap map;  ///< learned at these values, from so many units that they tell what no unit looks like
  struct Information {
    UnitMap map;  ///< learned where the fit began, of which the rings are
    int segment = 0;
    std::vector<std::string> names;           ///< of those that were fitted
    std::vector<std::vector<double>> slopes;  ///< by name and ring: of log(expected power), over the value's logarithm
    double kurtosis = 3;                      ///< of units at the values found
    std::vector<double> share;                ///< by ring: of the expected power there, that is the map's
  };
  std::optional<Information> information;  ///< none where no segment shows a map
};
/// Begins with `values`, at which `start` was learned. The parameters' likelihood is that of the map's spectrum
/// (Whittle: rings of cosines with exponentially distributed squares, noise's part known) under units simulated at
/// them: the strength is solved for, the others (magnitudes) are sought over their typical ranges. `without` and
/// `seed`: what `start` was learned with. The result's values are those given where no segment shows a map. Throws what
/// simulating throws.
UnitMapFit fit_unit_map(const Experiment& experiment, const Rung& rung, const Hypothesis& hypothesis,
                        const std::map<std::string, double>& values, UnitMap start,
                        const std::vector<StatVector>& without, std::uint64_t seed);
/// Standard deviations of the logarithms of the parameters that were fitted; all arguments as they were then. Throws
/// what simulating throws.
std::map<std::string, double> unit_map_deviations(const Experiment& experiment, const Rung& rung,
                                                  const Hypothesis& hypothesis, const UnitMapFit& fit,
                                                  std::uint64_t seed);

}  // namespace binrig
