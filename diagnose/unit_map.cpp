#include "diagnose/unit_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>
#include <Eigen/Eigenvalues>

#include "compare/probability.h"
#include "core/parallel.h"
#include "diagnose/map_rings.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double least_coherence = 0.4;      // of a segment's change that is common to all captures
constexpr double least_common = 1e-3;        // of a ring's power: what halves of the captures have in common scatters
constexpr double least_of_strongest = 1e-3;  // ring's power: below, the map's is what leaks from the border
constexpr double most_bands = 8;             // squares of some fifty cosines, and rings a third wide
constexpr double strengths[] = {0.25, 0.5, 1, 2, 4};

double sum_of_squares(const std::vector<double>& map) {
  double sum = 0;
  for (double v : map) sum += v * v;
  return sum;
}

double kurtosis_of(const std::vector<double>& map) {
  double fourth = 0;
  for (double v : map) fourth += v * v * v * v;
  const double square = sum_of_squares(map);
  return square > 0 ? fourth * static_cast<double>(map.size()) / (square * square) : 3;
}

CosineTransform squares_of(const std::vector<double>& map, int cols) { return transform(map, cols).cwiseAbs2(); }

CosineTransform tapered_squares(const std::vector<double>& map, int cols, UnitMap::Direction direction) {
  return squares_of(taper(map, cols, direction == UnitMap::rows), cols);
}

/// Means of cosines' squares by ring; infinite where fewer than `enough` are asked for. `counts`: by row and column.
template <typename Counts>
std::vector<double> power_by_ring(const CosineTransform& squares, const Counts& counts, double enough) {
  const int rows = static_cast<int>(squares.rows()), cols = static_cast<int>(squares.cols());
  std::vector<double> power(modes_of(rows, cols).size(), 0), count(power.size(), 0);
  for (int i = 1; i < rows * cols; ++i) {
    const int row = i / cols, col = i % cols, ring = ring_of(row, col, rows, cols);
    if (!counts(row, col)) continue;
    power[ring] += squares(row, col);
    count[ring] += 1;
  }
  for (std::size_t r = 0; r < power.size(); ++r)
    power[r] = count[r] < enough ? std::numeric_limits<double>::infinity() : power[r] / count[r];
  return power;
}

constexpr auto any = [](const auto&...) { return true; };

UnitMap::Spectrum spectrum_of(const std::vector<double>& map, int cols) {
  UnitMap::Spectrum spectrum;
  spectrum.power = power_by_ring(squares_of(map, cols), any, 1);
  for (const auto direction : {UnitMap::rows, UnitMap::columns}) {
    const CosineTransform squares = tapered_squares(map, cols, direction);
    UnitMap::Banded& banded = spectrum.tapered[direction];
    banded.all = power_by_ring(squares, any, 1);
    banded.varying = power_by_ring(
        squares, [&](int row, int col) { return (direction == UnitMap::rows ? row : col) == 0; }, 1);
    for (std::size_t r = 0; r < banded.all.size(); ++r)
      if (std::isinf(banded.varying[r])) banded.varying[r] = banded.all[r];
  }
  spectrum.kurtosis = spectrum.least_kurtosis = kurtosis_of(map);
  return spectrum;
}

/// Mean of as many, each as it is asked for.
template <typename SpectrumOf>
UnitMap::Spectrum mean_spectrum(std::size_t count, const SpectrumOf& one) {
  UnitMap::Spectrum mean;
  mean.kurtosis = 0;
  mean.least_kurtosis = std::numeric_limits<double>::infinity();
  double log_kurtosis = 0, square = 0;
  const double share = 1 / static_cast<double>(count);
  const auto add = [share](std::vector<double>& sum, const std::vector<double>& its) {
    sum.resize(its.size(), 0);
    for (std::size_t r = 0; r < its.size(); ++r) sum[r] += share * its[r];
  };
  for (std::size_t k = 0; k < count; ++k) {
    const UnitMap::Spectrum its = one(k);
    add(mean.power, its.power);
    for (const auto direction : {UnitMap::rows, UnitMap::columns}) {
      add(mean.tapered[direction].varying, its.tapered[direction].varying);
      add(mean.tapered[direction].all, its.tapered[direction].all);
    }
    mean.kurtosis += share * its.kurtosis;
    mean.least_kurtosis = std::min(mean.least_kurtosis, its.kurtosis);
    const double log_of_its = std::log(std::max(its.kurtosis, 1.0));
    log_kurtosis += share * log_of_its;
    square += share * log_of_its * log_of_its;
  }
  mean.kurtosis_scatter = std::sqrt(std::max(0.0, square - log_kurtosis * log_kurtosis));
  return mean;
}

/// Squares of the cosines that vary along one direction alone, of the map tapered along it, over what is expected of
/// them in their rings: by how many standard deviations their sum is beyond their number. Bands stand out there,
/// however weak they are.
double band_excess(const CosineTransform& squares, UnitMap::Direction direction, const std::vector<double>& expected) {
  const int rows = static_cast<int>(squares.rows()), cols = static_cast<int>(squares.cols());
  double sum = 0, count = 0;
  for (int k = 1; k < (direction == UnitMap::rows ? cols : rows); ++k) {
    const int row = direction == UnitMap::rows ? 0 : k, col = direction == UnitMap::rows ? k : 0;
    const int ring = ring_of(row, col, rows, cols);
    if (ring < 1 || std::isinf(expected[ring])) continue;  // where poses and lens take their part
    sum += squares(row, col) / std::max(expected[ring], 1e-12);
    count += 1;
  }
  return count > 0 ? (sum - count) / std::sqrt(2 * count) : 0;
}

}  // namespace

Whitened left_of(const Metric& train, const Metric& test, const Whitened& change) {
  Whitened left = train.apply(change);
  const Whitened on_test = test.apply(change);
  for (std::size_t i = 0; i < left.size(); ++i) left[i] += on_test[i];
  compress(left);
  return left;
}

std::vector<Whitened> left_of_nulls(const Rung& rung) {
  std::vector<Whitened> nulls(std::min<std::size_t>(rung.nulls.size(), 24));
  parallel_for(static_cast<int>(nulls.size()), [&](int k) { nulls[k] = remains_of(rung, rung.nulls[k], {}).rest; });
  return nulls;
}

std::vector<Trial> UnitMap::trials_of(const Rung& rung, const SensorModel& model, std::uint64_t seed, int frames,
                                      int count) {
  std::vector<Trial> trials;
  for (int k = 0; k < count; ++k)
    trials.push_back({model, rung.offsets, seed + static_cast<std::uint64_t>(k), Part::all, frames, frames > 0});
  return trials;
}

std::vector<Whitened> UnitMap::changes(const Rung& rung, const std::vector<StatVector>& without,
                                       const std::vector<StatVector>& with) {
  std::vector<Whitened> result;
  for (std::size_t k = 0; k < with.size(); ++k) {
    StatVector difference(with[k].size());
    for (std::size_t i = 0; i < difference.size(); ++i) difference[i] = with[k][i] - without[k][i];
    result.push_back(rung.standard.difference(difference));
  }
  return result;
}

UnitMap::UnitMap(const Layout& layout, const Rung& rung, const std::vector<StatVector>& without,
                 const std::vector<StatVector>& with)
    : spread_(rung.standard.spread()), train_(rung.train), test_(rung.test) {
  const std::vector<Whitened> change = changes(rung, without, with);
  units_ = static_cast<double>(change.size());
  const std::vector<Whitened> nulls = left_of_nulls(rung);
  for (std::size_t s = 0; s < binrig::segments().size(); ++s) {
    std::vector<const Block*> blocks;
    for (const Block& block : layout.blocks)
      if (block.segment == static_cast<int>(s) && block.rows > 1 &&
          (blocks.empty() || (block.rows == blocks[0]->rows && block.cols == blocks[0]->cols)))
        blocks.push_back(&block);
    const int n = static_cast<int>(blocks.size());
    if (n < 2) continue;
    Segment segment;
    segment.name = binrig::segments()[s].name;
    segment.cells = blocks[0]->size;
    segment.cols = blocks[0]->cols;
    Eigen::MatrixXd moments = Eigen::MatrixXd::Zero(n, n);
    for (const Whitened& one : change)
      for (int a = 0; a < n; ++a)
        for (int b = 0; b <= a; ++b) {
          double sum = 0;
          for (int i = 0; i < segment.cells; ++i) sum += one[blocks[a]->offset + i] * one[blocks[b]->offset + i];
          moments(a, b) += sum / (segment.cells * static_cast<double>(change.size()));
        }
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(moments);  // reads the lower half
    const double largest = solver.eigenvalues()[n - 1], trace = moments.trace();
    if (trace < 1e-4 || largest < least_coherence * trace) continue;
    const Eigen::VectorXd loading = solver.eigenvectors().col(n - 1) * std::sqrt(largest);
    for (int c = 0; c < n; ++c) segment.loadings.push_back({blocks[c]->offset, blocks[c]->train, loading[c]});

    double square = 0, known = 0;
    for (const Whitened& rest : nulls)
      for (const Block* block : blocks)
        for (int i = block->offset; block->train && i < block->offset + block->size; ++i)
          if (spread_[i] > 0) square += static_cast<double>(rest[i]) * rest[i], known += 1;
    if (known == 0 || square <= 0) continue;
    segment.noise = square / known;
    segment.noise_spectrum = mean_spectrum(
        nulls.size(), [&](std::size_t k) { return spectrum_of(map_of(segment, nulls[k]), segment.cols); });
    segments_.push_back(std::move(segment));
    segments_.back().spectrum = spectrum_of_units(static_cast<int>(segments_.size()) - 1, change);
  }
}

UnitMap::Spectrum UnitMap::spectrum_of_units(int s, const std::vector<Whitened>& change) const {
  const Segment& segment = segments_[s];
  return mean_spectrum(change.size(), [&](std::size_t k) {
    const Whitened left = left_of(train_, test_, change[k]);
    Spectrum spectrum = spectrum_of(map_of(segment, left), segment.cols);
    const auto& [one, other] = halves_of(segment, left);
    const std::vector<double> common =
        power_by_ring(transform(one, segment.cols).cwiseProduct(transform(other, segment.cols)), any, 1);
    for (std::size_t r = 0; r < common.size(); ++r)
      spectrum.power[r] = std::clamp(common[r], least_common * spectrum.power[r], spectrum.power[r]);
    return spectrum;
  });
}

std::vector<double> UnitMap::modes(int s) const {
  constexpr double at_best = 0.1;  // what is expected of a ring is known to
  std::vector<double> modes = modes_of(segments_[s].cells / segments_[s].cols, segments_[s].cols);
  for (double& m : modes) m = 1 / (1 / m + at_best * at_best / 2);
  return modes;
}

std::optional<int> UnitMap::strongest(const Whitened& rest) const {
  std::optional<int> best;
  double most = 0;
  for (std::size_t s = 0; s < segments_.size(); ++s) {
    const double its = gain(rest, rest, segments_[s].name).train;
    if (its > most) most = its, best = static_cast<int>(s);
  }
  return best;
}

UnitMap::Match UnitMap::match(int s, const Whitened& rest, const Spectrum& units) const {
  const Segment& segment = segments_[s];
  const Spectrum seen = spectrum_of(map_of(segment, rest), segment.cols);
  std::vector<double> modes = this->modes(s);
  const double least = least_of_strongest * *std::ranges::max_element(seen.power);
  for (std::size_t r = 0; r < modes.size(); ++r)
    if (seen.power[r] < least) modes[r] = 0;
  Match best;
  best.log_likelihood = -std::numeric_limits<double>::infinity();
  for (double log_scale = -6; log_scale <= 6; log_scale += 0.02) {
    double log_likelihood = 0;
    for (std::size_t r = 0; r < modes.size(); ++r) {
      const double expected = std::exp(log_scale) * units.power[r] + segment.noise_spectrum.power[r];
      log_likelihood -= modes[r] / 2 * (std::log(expected) + seen.power[r] / expected);
    }
    if (log_likelihood > best.log_likelihood) best.log_likelihood = log_likelihood, best.log_scale = log_scale;
  }
  for (std::size_t r = 0; r < modes.size(); ++r) {
    const double of_map = std::exp(best.log_scale) * units.power[r],
                 expected = of_map + segment.noise_spectrum.power[r];
    const double ratio = seen.power[r] / expected;
    best.slope.push_back(modes[r] > 0 ? of_map / expected : 0);
    best.misfit += modes[r] * (ratio - 1 - std::log(std::max(ratio, 1e-12)));
  }
  return best;
}

template <typename Counts>
void UnitMap::sums(const Segment& segment, int cell, const Whitened& rest, const Counts& counts, double& b,
                   double& g) const {
  for (const Loading& loading : segment.loadings) {
    const int i = loading.offset + cell;
    if (!counts(loading) || spread_[i] == 0) continue;
    b += loading.value * rest[i];
    g += loading.value * loading.value;
  }
}

template <typename Counts>
void UnitMap::estimate(const Segment& segment, const Whitened& rest, const Counts& counts,
                       std::vector<double>& map) const {
  for (int i = 0; i < segment.cells; ++i) {
    double b = 0, g = 0;
    sums(segment, i, rest, counts, b, g);
    if (g > 0) map[i] = b / g;
  }
}

std::vector<double> UnitMap::map_of(const Segment& segment, const Whitened& rest) const {
  std::vector<double> map(segment.cells, 0);
  estimate(segment, rest, any, map);
  return map;
}

std::array<std::vector<double>, 2> UnitMap::halves_of(const Segment& segment, const Whitened& rest) const {
  const std::vector<double> by_all = map_of(segment, rest);
  std::array<std::vector<double>, 2> halves{by_all, by_all};
  const Loading* first = segment.loadings.data();
  for (int half = 0; half < 2; ++half)
    estimate(
        segment, rest, [&](const Loading& loading) { return (&loading - first) % 2 == half; }, halves[half]);
  return halves;
}

double UnitMap::noise_in_map(const Segment& segment, const Whitened& rest) const {
  double noise = 0;
  for (int i = 0; i < segment.cells; ++i) {
    double b = 0, g = 0;
    sums(segment, i, rest, any, b, g);
    if (g > 0) noise += segment.noise / g;
  }
  return noise;
}

UnitMap::Gain UnitMap::gain(const Whitened& train, const Whitened& test, const std::string& only_segment) const {
  const auto is_train = [](const Loading& loading) { return loading.train; };
  const auto is_test = [](const Loading& loading) { return !loading.train; };
  Gain total;
  for (const Segment& segment : segments_) {
    if (!only_segment.empty() && segment.name != only_segment) continue;
    std::vector<double> b(segment.cells), g(segment.cells);
    for (int i = 0; i < segment.cells; ++i) sums(segment, i, train, is_train, b[i], g[i]);
    double best = 0, variance = 0;
    for (const double a : strengths) {
      double gain = 0;
      for (int i = 0; i < segment.cells; ++i) {
        const double share = a * a / (segment.noise + g[i] * a * a);
        gain += b[i] * b[i] * share - segment.noise * std::log1p(g[i] * a * a / segment.noise);
      }
      if (gain > best) best = gain, variance = a * a;
    }
    if (variance == 0) continue;
    total.train += best;
    for (int i = 0; i < segment.cells; ++i) {
      double on_test = 0, square = 0;
      sums(segment, i, test, is_test, on_test, square);
      const double value = b[i] * variance / (segment.noise + g[i] * variance);
      total.test += value * (2 * on_test - value * square);
    }
  }
  return total;
}

bool UnitMap::has_bands(const Whitened& rest) const {
  // What a ring's few other cosines say scatters: one in 2,000 smooth maps is beyond, one in 50 of those that are as
  // coarse as a quarter of the image and ten times the noise.
  constexpr double clearly_bands = 16;
  constexpr double enough = 8;
  for (const Segment& segment : segments_) {
    const auto map = map_of(segment, rest);
    for (const Direction direction : {rows, columns}) {
      const CosineTransform squares = tapered_squares(map, segment.cols, direction);
      std::vector<double> expected = power_by_ring(
          squares, [](int row, int col) { return row > 0 && col > 0; }, enough);
      for (std::size_t r = 0; r < expected.size(); ++r)
        expected[r] = std::max(expected[r], segment.noise_spectrum.tapered[direction].all[r]);
      const double bands = band_excess(squares, direction, expected);
      if (tracing()) fmt::print(stderr, "  unit map in {}: bands beside others by {:.1f}\n", segment.name, bands);
      if (bands > clearly_bands) return true;
    }
  }
  return false;
}

bool UnitMap::looks_random(const Whitened& rest) const {
  constexpr double by_chance = 1e-4;
  constexpr double enough_units = 8;  // to know by how much kurtosis scatters
  constexpr double scattered = 10;    // kurtosis of pixels here and there
  if (has_bands(rest)) return false;
  for (std::size_t s = 0; s < segments_.size(); ++s) {
    const Segment& segment = segments_[s];
    const auto map = map_of(segment, rest);
    const Match found = match(static_cast<int>(s), rest, segment.spectrum);
    for (const Direction direction : {rows, columns}) {
      const Banded &of_noise = segment.noise_spectrum.tapered[direction],
                   &of_units = segment.spectrum.tapered[direction];
      std::vector<double> expected(of_units.all.size());
      // Few units say too little of cosines that have less than others of their rings.
      for (std::size_t r = 0; r < expected.size(); ++r)
        expected[r] = std::max(of_noise.all[r], of_noise.varying[r]) +
                      std::exp(found.log_scale) * std::max(of_units.all[r], of_units.varying[r]);
      const double bands = band_excess(tapered_squares(map, segment.cols, direction), direction, expected);
      if (tracing()) fmt::print(stderr, "  unit map in {}: bands stand out by {:.1f}\n", segment.name, bands);
      if (bands > most_bands) return false;
    }
    const double noise = noise_in_map(segment, rest);
    if (sum_of_squares(map) < 2 * noise) continue;  // too little of a map to judge it
    const double misfit = found.misfit;
    // What rings are expected to have is a mean over few units, and scatters, too.
    const double most =
        (1 + 1 / units_) * chi_square_threshold(by_chance, static_cast<double>(segment.spectrum.power.size()) + 1);
    const double kurtosis = kurtosis_of(map), usual = segment.spectrum.kurtosis;
    // Noise takes of a kurtosis' excess over 3 what it takes of the power, squared.
    const double share = 1 - noise / sum_of_squares(map), expected = 3 + (usual - 3) * share * share;
    const double too_even =
        units_ < enough_units || usual > scattered
            ? 0
            : std::max(0.0, std::log(expected / kurtosis)) / std::max(segment.spectrum.kurtosis_scatter, 0.02);
    if (tracing())
      fmt::print(
          stderr,
          "  unit map in {}: {:.1f} times the noise, misfit {:.1f} (at most {:.1f}), kurtosis {:.1f} ({:.1f}), too "
          "even by {:.1f}\n",
          segment.name, sum_of_squares(map) / noise, misfit, most, kurtosis, usual, too_even);
    if (misfit + too_even * too_even > most) return false;
    // A wave has 1.5 and two levels have 1; a Gaussian map has 3, smooth ones (of few independent patches) 2 .. 4, and
    // up to 6 where cells are known unequally well. Beyond are scattered pixels: the fewer, the more.
    if (kurtosis < 0.62 * std::min(segment.spectrum.least_kurtosis, 5.0)) return false;
    if (usual < scattered && kurtosis > 1.7 * usual) return false;
  }
  return true;
}

}  // namespace binrig
