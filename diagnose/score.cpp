#include "diagnose/score.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace binrig {
namespace {

constexpr double beyond_chance = 6;  // of the spreads among simulations

/// "poses" and "intrinsics" follow the segments of the statistics.
std::size_t parts() { return segments().size() + 2; }
std::string part_name(std::size_t s) {
  return s < segments().size() ? segments()[s].name : s == segments().size() ? "poses" : "intrinsics";
}
std::string part_group(std::size_t s) { return s < segments().size() ? segments()[s].group : "poses"; }

/// Mean square by segment of a residual on one side of the split; -1 where nothing is known.
std::vector<double> mean_squares(const Layout& layout, const Standard& standard, const Whitened& y,
                                 const Stated& stated, bool train) {
  std::vector<double> sum(segments().size(), 0), count(segments().size(), 0);
  for (const auto& block : layout.blocks) {
    if (block.train != train) continue;
    for (int i = block.offset; i < block.offset + block.size; ++i)
      if (standard.spread()[i] > 0) sum[block.segment] += static_cast<double>(y[i]) * y[i], count[block.segment] += 1;
  }
  for (std::size_t s = 0; s < sum.size(); ++s) sum[s] = count[s] > 0 ? sum[s] / count[s] : -1;
  sum.push_back(stated.poses);
  sum.push_back(stated.intrinsics);
  return sum;
}

/// A recording in which nothing is missing; what all captures share is found on train, as it is of the data.
std::vector<double> null_squares(const Layout& layout, const Rung& rung, const Whitened& null, bool train) {
  Explained own = rung.train.explain(null);
  if (!train) own = rung.test.explain(null, {}, own.global);
  return mean_squares(layout, rung.standard, own.rest, own.stated, train);
}

/// As much of a rung as scores() asks of the last one, on the scale on which every element counts in units of its own
/// spread. Where whole maps move together they say hardly anything about a model that lets them move, and one that
/// shakes without reason would look as good as one that does not.
Rung with_modes(const Rung& rung) {
  Rung result;
  result.fit = rung.fit;
  result.standard = rung.standard;
  result.place = rung.place;
  const auto changed = [&](const Whitened& y) { return rung.standard.with_modes(y); };
  result.train = rung.train.on_scale(changed);
  result.test = rung.test.on_scale(changed, result.train.global_posterior());
  for (std::size_t k = 0; k < rung.nulls.size(); ++k)
    result.nulls.push_back(rung.others[k % rung.others.size()].with_modes(rung.nulls[k]));
  return result;
}

}  // namespace

double proper_score(const Layout& layout, const Rung& rung, Part part) {
  double proper = 0, known = 0;
  // Where the targets really stood is no fault of the model: rung.rest is free of it.
  const Whitened rest = rung.standard.with_modes(rung.rest);
  for (std::size_t b = 0; b < layout.blocks.size(); ++b) {
    const Block& block = layout.blocks[b];
    if (part != Part::all && block.train != (part == Part::train)) continue;
    proper += rung.standard.log_determinant(b);
    for (int i = block.offset; i < block.offset + block.size; ++i) {
      if (rung.standard.spread()[i] <= 0) continue;
      proper += static_cast<double>(rest[i]) * rest[i];
      known += 1;
    }
  }
  return known > 0 ? proper / known : 0;
}

double proper_score_without_floor_of_bias(const Layout& layout, const Rung& rung) {
  std::size_t segment = 0;
  double known = 0, bias = 0;  // elements
  for (const Block& block : layout.blocks) {
    const bool is_bias = segments()[block.segment].name == "bias";
    if (is_bias) segment = static_cast<std::size_t>(block.segment);
    for (int i = block.offset; i < block.offset + block.size; ++i)
      if (!block.train && rung.standard.spread()[i] > 0) known += 1, bias += is_bias;
  }
  std::vector<double> nulls(rung.nulls.size());
  parallel_for(static_cast<int>(nulls.size()),
               [&](int k) { nulls[k] = null_squares(layout, rung, rung.nulls[k], false)[segment]; });
  double own = 0;
  for (const double square : nulls) own += square / static_cast<double>(nulls.size());
  const double score = proper_score(layout, rung),
               square = mean_squares(layout, rung.standard, rung.rest, rung.test_stated, false)[segment];
  return bias > 0 && own > 0 ? score + bias / known * (square / own - square + std::log(own)) : score;
}

std::vector<double> squares_by_capture(const Layout& layout, const Whitened& rest, bool with_bias) {
  std::vector<double> squares(layout.captures, 0);
  for (const Block& block : layout.blocks)
    if (with_bias || segments()[block.segment].name != "bias")
      for (int i = block.offset; i < block.offset + block.size; ++i)
        squares[block.capture] += static_cast<double>(rest[i]) * rest[i];
  return squares;
}

std::vector<int> captures_that_stand_out(const Layout& layout, const Rung& rung) {
  constexpr double far_out = 2;  // standard deviations of what simulations do
  constexpr double much = 30;    // of a square, beside that
  const auto measured = squares_by_capture(layout, rung.rest, false);
  std::vector<std::vector<double>> nulls(rung.nulls.size());
  parallel_for(static_cast<int>(nulls.size()),
               [&](int k) { nulls[k] = squares_by_capture(layout, remains_of(rung, rung.nulls[k], {}).rest, false); });
  std::vector<int> captures;
  for (int c = 0; c < layout.captures; ++c) {
    double sum = 0, square = 0;
    for (const auto& null : nulls) sum += null[c], square += null[c] * null[c];
    const double n = static_cast<double>(nulls.size()), mean = sum / n;
    const double deviation = std::sqrt(std::max(0.0, square / n - mean * mean));
    if (measured[c] > mean + far_out * deviation && measured[c] > mean + much) captures.push_back(c);
  }
  return captures;
}

std::vector<Score> scores(const Layout& layout, const std::vector<SceneMotion>& motions, const Rung& last_rung,
                          const StatVector& data, const std::vector<const Rung*>& rungs) {
  const Rung shaking = last_rung.standard.has_modes() ? with_modes(last_rung) : Rung{};
  const Rung& last = last_rung.standard.has_modes() ? shaking : last_rung;
  std::vector<double> floor(parts(), 0);
  std::vector<std::vector<double>> nulls;
  for (const auto& null : last.nulls) {
    nulls.push_back(null_squares(layout, last, null, false));
    for (std::size_t s = 0; s < floor.size(); ++s) floor[s] += nulls.back()[s] / last.nulls.size();
  }
  // Of three intrinsics, chance makes more than of a thousand cells: in units of what it makes.
  const auto part_score = [&](std::size_t s, double square) {
    return 1 + (square - floor[s]) / (s < segments().size() ? 1 : std::max(1.0, floor[s]));
  };
  const auto average = [&](const std::vector<double>& squares, std::size_t first) {
    double sum = 0, count = 0;
    for (std::size_t s = 0; s < first; ++s)
      if (squares[s] >= 0 && floor[s] > 0) sum += part_score(s, squares[s]), count += 1;
    return count > 0 ? sum / count : 0;
  };
  std::vector<double> own;
  for (const auto& null : nulls) own.push_back(average(null, parts()));
  std::sort(own.begin(), own.end());

  std::vector<Score> result;
  for (const Rung* of : rungs) {
    const Rung& rung = *of;
    const Standard* model = &rung.standard;
    StatVector difference(data.size());
    for (std::size_t i = 0; i < data.size(); ++i) difference[i] = data[i] - model->mean()[i];
    std::vector<double> place = rung.place;  // of the targets, which come first; parameters stand at 0
    place.resize(last.place.size(), 0);
    const Whitened y = last.standard.with_modes(last.standard.difference(difference));
    const Remains remains = remains_of(last, rung.model, y, place);
    const auto squares = mean_squares(layout, last.standard, remains.rest, remains.test_stated, false);
    Score score;
    score.heldout = average(squares, parts());
    score.statistics = average(squares, segments().size());
    if (!own.empty()) {
      score.band_low = own[static_cast<std::size_t>(0.025 * (own.size() - 1))];
      score.band_high = own[static_cast<std::size_t>(std::ceil(0.975 * (own.size() - 1)))];
    }
    std::map<std::string, double> count;
    for (std::size_t s = 0; s < squares.size(); ++s) {
      if (squares[s] < 0 || floor[s] <= 0) continue;
      score.by_segment[part_name(s)] = part_score(s, squares[s]);
      score.by_channel[part_group(s)] += part_score(s, squares[s]);
      count[part_group(s)] += 1;
    }
    for (auto& [channel, value] : score.by_channel) value /= count[channel];

    difference = registered(layout, motions, std::move(difference), place, remains.nuisances);
    double bias = 0, bias_count = 0, noise = 0, noise_count = 0, mask = 0, mask_count = 0;
    for (const auto& block : layout.blocks) {
      if (block.train) continue;
      const std::string& name = segments()[block.segment].name;
      for (int i = block.offset; i < block.offset + block.size; ++i) {
        const float d = difference[i];
        if (std::isnan(d) || model->spread()[i] <= 0) continue;
        if (name == "bias") bias += static_cast<double>(d) * d, bias_count += 1;
        if (name == "noise") noise += d, noise_count += 1;
        if (name == "drop-out") {
          const double a = std::pow(std::sin(data[i]), 2), b = std::pow(std::sin(model->mean()[i]), 2);
          mask += std::abs(a - b), mask_count += 1;
        }
      }
    }
    score.proper = proper_score(layout, rung);
    score.bias_rms_mm = bias_count > 0 ? std::sqrt(bias / bias_count) : 0;
    score.noise_ratio = noise_count > 0 ? std::exp(0.5 * noise / noise_count) : 1;
    score.mask_difference = mask_count > 0 ? mask / mask_count : 0;
    result.push_back(score);
  }
  return result;
}

bool SegmentFit::significant() const {
  // Both: beyond what chance does, and large enough to matter: half of what randomness and practical floor are
  // together, or a tenth of that where chance is out of the question, once or twice.
  return excess > beyond_chance * spread && (excess > 1 || (excess > 0.1 && (excess > 10 * spread || on_both_parts)));
}

std::vector<SegmentFit> goodness_of_fit(const Layout& layout, const Rung& rung) {
  constexpr double least_mean = 0.01;
  std::vector<SegmentFit> result;
  for (bool train : {true, false}) {
    const auto measured =
        mean_squares(layout, rung.standard, rung.rest, train ? rung.train_stated : rung.test_stated, train);
    std::vector<double> sum(measured.size(), 0), square(measured.size(), 0);
    for (const auto& null : rung.nulls) {
      const auto own = null_squares(layout, rung, null, train);
      for (std::size_t s = 0; s < own.size(); ++s) sum[s] += own[s], square[s] += own[s] * own[s];
    }
    const double n = static_cast<double>(rung.nulls.size());
    for (std::size_t s = 0; s < measured.size(); ++s) {
      if (measured[s] < 0) continue;
      const double mean = sum[s] / n, variance = std::max(0.0, square[s] / n - mean * mean);
      // A model that never clears a pixel scatters by nothing, and a hole is beyond it all the same.
      const double ratio = measured[s] / std::max(mean, least_mean);
      result.push_back({part_name(s), part_group(s), train, ratio, measured[s] - mean, std::sqrt(variance)});
    }
  }
  for (SegmentFit& fit : result)
    fit.on_both_parts = std::ranges::count_if(result, [&](const SegmentFit& one) {
                          return one.segment == fit.segment && one.excess > beyond_chance * one.spread;
                        }) == 2;
  return result;
}

Leftovers unexplained(const Layout& layout, const Rung& rung) {
  Leftovers result;
  for (const SegmentFit& fit : goodness_of_fit(layout, rung))
    if (fit.significant()) result.emplace(fit.segment, fit.train);
  return result;
}

bool needlessly_random(const Layout& layout, const Rung& rung) {
  return std::ranges::any_of(goodness_of_fit(layout, rung), [](const SegmentFit& fit) {
    return fit.excess < -beyond_chance * fit.spread && fit.excess < -0.05;
  });
}

}  // namespace binrig
