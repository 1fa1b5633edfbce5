#include "diagnose/drawn_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "diagnose/unit_map.h"

namespace binrig {
namespace {

constexpr double most_of_one = 9;  // of what a cosine's square is expected to be: three standard deviations
constexpr double unlike = 4;       // of a ring's power over what is expected
constexpr double the_same = 0.5;   // correlation of captures

RingSquares squares_of(const Whitened& rest, int offset, int cells, int cols) {
  return squares_by_ring({rest.begin() + offset, rest.begin() + offset + cells}, cols);
}

double sum(const std::vector<double>& values, double most) {
  double total = 0;
  for (const double value : values) total += std::min(value, most);
  return total;
}

}  // namespace

DrawnMap::DrawnMap(const Layout& layout, const Rung& rung, const std::vector<StatVector>& without,
                   const std::vector<StatVector>& with) {
  std::vector<Whitened> draws = UnitMap::changes(rung, without, with);
  for (Whitened& draw : draws) draw = left_of(rung.train, rung.test, draw);
  const std::vector<Whitened> nulls = left_of_nulls(rung);
  for (const Block& block : layout.blocks) {
    if (segments()[block.segment].name != "bias" || block.rows < 2) continue;
    Capture capture{block.offset, block.size, block.cols, block.train, {}, {}};
    const auto power = [&](const std::vector<Whitened>& of) {
      std::vector<double> mean;
      for (const Whitened& one : of) {
        const RingSquares squares = squares_of(one, block.offset, block.size, block.cols);
        mean.resize(squares.size(), 0);
        for (std::size_t r = 0; r < squares.size(); ++r)
          if (!squares[r].empty())
            mean[r] += sum(squares[r], std::numeric_limits<double>::infinity()) /
                       static_cast<double>(squares[r].size() * of.size());
      }
      return mean;
    };
    capture.noise = power(nulls);
    capture.drawn = power(draws);
    if (!nulls.empty() && !draws.empty() && std::ranges::all_of(capture.noise, [](double p) { return p > 0; }))
      captures_.push_back(std::move(capture));
  }
}

double DrawnMap::gain_of(bool train, const std::vector<RingSquares>& squares, double strength) const {
  double gain = 0;
  for (std::size_t c = 0; c < captures_.size(); ++c) {
    const Capture& capture = captures_[c];
    if (capture.train != train) continue;
    for (std::size_t r = 0; r < capture.noise.size(); ++r) {
      const double noise = capture.noise[r], expected = noise + strength * capture.drawn[r];
      gain += sum(squares[c][r], most_of_one * expected) * (1 / noise - 1 / expected) -
              static_cast<double>(squares[c][r].size()) * std::log(expected / noise);
    }
  }
  return gain;
}

bool DrawnMap::looks_alike(const std::vector<RingSquares>& squares, double strength) const {
  constexpr double enough = 0.5;  // of the noise: what a ring must be expected to have more, to be judged
  std::vector<double> seen, expected;
  for (std::size_t c = 0; c < captures_.size(); ++c) {
    const Capture& capture = captures_[c];
    if (!capture.train) continue;
    seen.resize(std::max(seen.size(), capture.noise.size()), 0);
    expected.resize(seen.size(), 0);
    for (std::size_t r = 0; r < capture.noise.size(); ++r) {
      const double drawn = strength * capture.drawn[r], modes = static_cast<double>(squares[c][r].size());
      if (drawn < enough * capture.noise[r]) continue;
      seen[r] += sum(squares[c][r], std::numeric_limits<double>::infinity()) - modes * capture.noise[r];
      expected[r] += modes * drawn;
    }
  }
  // What is slow, poses and lens take more of than of a draw. What is fine they leave: a bend has none.
  double fine_seen = 0, fine_expected = 0;
  const double half = std::accumulate(expected.begin(), expected.end(), 0.0) / 2;
  for (std::size_t r = seen.size(); r-- > 0;) {
    if (expected[r] > 0 && seen[r] > unlike * expected[r]) return false;
    if (fine_expected < half) fine_seen += seen[r], fine_expected += expected[r];
  }
  return unlike * fine_seen >= fine_expected;
}

double DrawnMap::in_common(const Whitened& train, const Whitened& test) const {
  struct Left {
    const float* cells;
    int count;
    double power;
  };
  std::vector<Left> captures;
  for (const Capture& capture : captures_) {
    const float* cells = (capture.train ? train : test).data() + capture.offset;
    const RingSquares rings = squares_of(capture.train ? train : test, capture.offset, capture.cells, capture.cols);
    double power = 0;
    for (std::size_t r = 0; r < rings.size(); ++r)
      power += sum(rings[r], std::numeric_limits<double>::infinity()) -
               static_cast<double>(rings[r].size()) * capture.noise[r];
    if (power > 0) captures.push_back({cells, capture.cells, power});
  }
  double together = 0, apart = 0;
  for (std::size_t a = 0; a < captures.size(); ++a)
    for (std::size_t b = 0; b < a; ++b) {
      if (captures[a].count != captures[b].count) continue;
      together += std::inner_product(captures[a].cells, captures[a].cells + captures[a].count, captures[b].cells, 0.0);
      apart += std::sqrt(captures[a].power * captures[b].power);
    }
  return apart > 0 ? together / apart : 0;
}

DrawnMap::Gain DrawnMap::gain(const Whitened& train, const Whitened& test) const {
  std::vector<RingSquares> squares;
  for (const Capture& capture : captures_)
    squares.push_back(squares_of(capture.train ? train : test, capture.offset, capture.cells, capture.cols));
  Gain best;
  for (double strength = 0.05; strength < 20; strength *= 1.2)
    if (const double gain = gain_of(true, squares, strength); gain > best.train) best = {gain, 0, strength, false};
  if (best.strength == 0) return best;
  best.test = gain_of(false, squares, best.strength);
  best.alike = looks_alike(squares, best.strength) && in_common(train, test) < the_same;
  return best;
}

}  // namespace binrig
