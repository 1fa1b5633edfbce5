#include "diagnose/standard.h"

#include <cmath>
#include <complex>
#include <limits>
#include <map>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "core/spectrum.h"

namespace binrig {
namespace {

constexpr float compression = 8.f;
constexpr int rings = 16;
constexpr double prior_simulations = 20;  // an element's own variance counts against its block's by this many

FrequencyBins all_rings([](int i, int j, int rows, int cols) {
  return std::min(rings - 1, static_cast<int>(2 * rings * std::hypot(dft_frequency(i, rows), dft_frequency(j, cols))));
});

bool is_bias_map(const Block& block) { return segments()[block.segment].name == "bias"; }
bool is_noise_map(const Block& block) { return segments()[block.segment].name == "noise"; }

/// Filters a grid by a gain per ring of frequency.
void filter(float* values, int rows, int cols, const std::vector<float>& gain) {
  cv::Mat grid(rows, cols, CV_32F, values);
  const Fft2 fft(rows, cols);
  std::vector<std::complex<float>> line;
  fft.forward(grid, line);
  const float scale = 1.f / (rows * cols);
  const std::vector<int>& ring = all_rings.of(rows, cols);
  for (std::size_t k = 0; k < line.size(); ++k) line[k] *= scale * gain[ring[k]];
  fft.inverse(line, grid);
}

/// A correlation learned from `simulations` recordings, drawn towards what is known beforehand, the more the fewer
/// there are for so many elements: whitened by a correlation of its own making, a simulation looks more regular than
/// any recording.
Eigen::MatrixXf shrunk_correlation(const Eigen::MatrixXf& own, const Eigen::MatrixXf& known, int simulations) {
  const float size = static_cast<float>(own.rows());
  const float shrink = std::max(0.15f, size / (size + 2.f * static_cast<float>(simulations)));
  Eigen::MatrixXf result = (1 - shrink) * own + shrink * known;
  result.diagonal() = own.diagonal().cwiseMax(1.f);
  return result;
}

}  // namespace

Standard::Standard(const Layout& layout, const StatVector& measured, const std::vector<StatVector>& simulations,
                   const std::vector<StatVector>& known_shift)
    : layout_(&layout) {
  const int n = static_cast<int>(simulations.size());
  const auto value = [&](int k, int i) {
    return simulations[k][i] - (known_shift.empty() || std::isnan(known_shift[k][i]) ? 0.f : known_shift[k][i]);
  };
  mean_.assign(layout.size, std::numeric_limits<float>::quiet_NaN());
  spread_.assign(layout.size, 0.f);
  small_.resize(layout.blocks.size());
  std::vector<double> ring_power(rings, 0), ring_count(rings, 0);
  std::map<std::size_t, Eigen::MatrixXf> own;                            // correlations by block
  std::map<std::pair<int, int>, std::pair<Eigen::MatrixXf, int>> alike;  // by segment and size: sum and count
  CommonModes::Covariance moving_together = CommonModes::Covariance::Zero();

  for (std::size_t b = 0; b < layout.blocks.size(); ++b) {
    const Block& block = layout.blocks[b];
    const double floor = segments()[block.segment].floor;
    std::vector<double> variance(block.size, -1);
    double pooled = 0, known = 0;
    for (int i = 0; i < block.size; ++i) {
      if (std::isnan(measured[block.offset + i])) continue;
      double s = 0, q = 0, m = 0;
      for (int k = 0; k < n; ++k) {
        const float x = value(k, block.offset + i);
        if (std::isnan(x)) continue;
        s += x, q += static_cast<double>(x) * x, m += 1;
      }
      if (m < 0.6 * n || m < 2) continue;
      mean_[block.offset + i] = static_cast<float>(s / m);
      variance[i] = std::max(0.0, (q - s * s / m) / (m - 1));
      pooled += variance[i], known += 1;
    }
    if (known == 0) continue;
    pooled /= known;
    for (int i = 0; i < block.size; ++i)
      if (variance[i] >= 0)
        spread_[block.offset + i] = static_cast<float>(
            std::sqrt((n * variance[i] + prior_simulations * pooled) / (n + prior_simulations) + floor * floor));

    const auto normalised = [&](int k, int i) {
      const float x = value(k, block.offset + i);
      return std::isnan(x) || spread_[block.offset + i] == 0
                 ? 0.f
                 : (x - mean_[block.offset + i]) / spread_[block.offset + i];
    };
    if (is_bias_map(block) && known > 0.5 * block.size) {
      const Fft2 fft(block.rows, block.cols);
      std::vector<std::complex<float>> line;
      cv::Mat grid(block.rows, block.cols, CV_32F);
      for (int k = 0; k < n; ++k) {
        for (int i = 0; i < block.size; ++i) grid.ptr<float>()[i] = normalised(k, i);
        fft.forward(grid, line);
        const std::vector<int>& ring = all_rings.of(block.rows, block.cols);
        for (std::size_t i = 0; i < line.size(); ++i) {
          ring_power[ring[i]] += std::norm(line[i]) / known;
          ring_count[ring[i]] += 1;
        }
      }
    } else if (is_noise_map(block) && n >= 8 && known > 0.1 * block.size) {
      std::vector<bool> counts(block.size);
      for (int i = 0; i < block.size; ++i) counts[i] = spread_[block.offset + i] > 0;
      const CommonModes& modes = modes_.try_emplace(b, block, counts).first->second;
      std::vector<float> map(block.size);
      for (int k = 0; k < n; ++k) {
        for (int i = 0; i < block.size; ++i) map[i] = normalised(k, i);
        const auto c = modes.coefficients(map.data()).cast<double>().eval();
        moving_together += c * c.transpose() / (n - 1);
      }
    } else if (block.rows == 1 && n >= 8) {
      Eigen::MatrixXf z(n, block.size);
      for (int k = 0; k < n; ++k)
        for (int i = 0; i < block.size; ++i) z(k, i) = normalised(k, i);
      own[b] = z.transpose() * z / static_cast<float>(n - 1);
      auto [at, fresh] = alike.try_emplace({block.segment, block.size}, own[b], 1);
      if (!fresh) at->second.first += own[b], ++at->second.second;
    }
  }
  for (const auto& [b, correlation] : own) {
    const Block& block = layout.blocks[b];
    const auto& [sum, count] = alike.at({block.segment, block.size});
    Eigen::MatrixXf learned = shrunk_correlation(sum / static_cast<float>(count),
                                                 Eigen::MatrixXf::Identity(block.size, block.size), n * count);
    // Captures differ, but less than a few simulations of each would have it.
    if (count > 1) learned = shrunk_correlation(correlation, learned, n / 16);
    for (int i = 0; i < block.size; ++i) {
      if (spread_[block.offset + i] > 0) continue;  // else others must not lend it what they know
      learned.row(i).setZero(), learned.col(i).setZero();
      learned(i, i) = 1;
    }
    const Eigen::LLT<Eigen::MatrixXf> factor(learned);
    if (factor.info() == Eigen::Success)
      small_[b] = factor.matrixL().solve(Eigen::MatrixXf::Identity(block.size, block.size));
  }

  calm_ = CommonModes::learned_change(moving_together / std::max<double>(1, static_cast<double>(modes_.size())));
  if (calm_.isZero()) modes_.clear();

  ring_gain_.assign(rings, 1.f);
  double total = 0, number = 0;
  for (int r = 0; r < rings; ++r)
    if (ring_count[r] > 0) total += ring_power[r], number += ring_count[r];
  if (total > 0)  // else the model has no noise
    for (int r = 0; r < rings; ++r) {
      const double relative = ring_count[r] > 0 ? ring_power[r] / ring_count[r] / (total / number) : 1;
      ring_gain_[r] = static_cast<float>(1 / std::sqrt(std::clamp(relative, 0.1, 10.0)));
    }
}

void Standard::whiten(Whitened& values) const {
  for (std::size_t b = 0; b < layout_->blocks.size(); ++b) {
    const Block& block = layout_->blocks[b];
    float* begin = values.data() + block.offset;
    if (is_bias_map(block)) {
      filter(begin, block.rows, block.cols, ring_gain_);
      for (int i = 0; i < block.size; ++i)
        if (spread_[block.offset + i] == 0) begin[i] = 0;
    } else if (const auto modes = modes_.find(b); modes != modes_.end()) {
      modes->second.apply(calm_, begin);
    } else if (small_[b].size() > 0) {
      Eigen::Map<Eigen::VectorXf> v(begin, block.size);
      v = (small_[b] * v).eval();
    }
  }
}

Whitened Standard::with_modes(Whitened y) const {
  if (!has_modes()) return y;
  using Change = CommonModes::Change;
  const Change back = (Change::Identity() + calm_).inverse() - Change::Identity();
  for (const auto& [b, modes] : modes_) modes.apply(back, y.data() + layout_->blocks[b].offset);
  return y;
}

double Standard::log_determinant(std::size_t b) const {
  const Block& block = layout_->blocks[b];
  double result = 0, known = 0;
  for (int i = block.offset; i < block.offset + block.size; ++i)
    if (spread_[i] > 0) result += 2 * std::log(spread_[i]), known += 1;
  if (is_bias_map(block)) {
    // Every frequency but those of the first and, where there is one, the middle column stands for its mirror, too. A
    // map with holes is taken for a piece of one without.
    const std::vector<int>& ring = all_rings.of(block.rows, block.cols);
    const int half_cols = block.cols / 2 + 1;
    for (std::size_t k = 0; k < ring.size(); ++k) {
      const int col = static_cast<int>(k) % half_cols;
      const int stands_for = col == 0 || 2 * col == block.cols ? 1 : 2;
      result -= 2 * stands_for * std::log(ring_gain_[ring[k]]) * known / block.size;
    }
  } else if (small_[b].size() > 0) {
    result -= 2 * small_[b].diagonal().array().log().sum();  // a triangle
  }
  return result;
}

Whitened Standard::difference(const StatVector& a) const {
  Whitened y(layout_->size, 0.f);
  for (int i = 0; i < layout_->size; ++i)
    if (spread_[i] > 0 && !std::isnan(a[i])) y[i] = a[i] / spread_[i];
  whiten(y);
  return y;
}

Whitened Standard::linear(const StatVector& statistics) const {
  StatVector d(layout_->size);
  for (int i = 0; i < layout_->size; ++i) d[i] = statistics[i] - mean_[i];
  return difference(d);
}

Whitened Standard::standardise(const StatVector& statistics) const {
  Whitened y = linear(statistics);
  compress(y);
  return y;
}

void compress(Whitened& residual) {
  for (float& v : residual)
    if (std::abs(v) > 0.5f) v = compression * std::asinh(v / compression);  // below, 1e-3 of it
}

void uncompress(Whitened& residual) {
  const float from = compression * std::asinh(0.5f / compression);
  for (float& v : residual)
    if (std::abs(v) > from) v = compression * std::sinh(v / compression);
}

float compression_slope(float compressed) { return 1.f / std::cosh(compressed / compression); }

double dot(const Whitened& a, const Whitened& b) {
  constexpr std::size_t piece = 2048;  // summed in single precision
  double total = 0;
  for (std::size_t i = 0; i < a.size(); i += piece) {
    const auto n = static_cast<Eigen::Index>(std::min(piece, a.size() - i));
    total += Eigen::Map<const Eigen::VectorXf>(a.data() + i, n).dot(Eigen::Map<const Eigen::VectorXf>(b.data() + i, n));
  }
  return total;
}

double misfit_by_blocks(const Layout& layout, const Whitened& residual) {
  double sum = 0, known = 0;
  int blocks = 0;
  for (const Block& block : layout.blocks) {
    const Eigen::Map<const Eigen::VectorXf> rest(residual.data() + block.offset, block.size);
    const auto count = (rest.array() != 0).count();
    if (count == 0) continue;
    sum += std::log(std::max(1.0, static_cast<double>(rest.squaredNorm()) / count));
    known += count;
    ++blocks;
  }
  return blocks > 0 ? known * sum / blocks : 0;
}

double left_by_most_captures(const Layout& layout, const Whitened& residual) {
  std::vector<double> square(layout.captures, 0), known(layout.captures, 0);
  for (const Block& block : layout.blocks) {
    if (segments()[block.segment].name == "bias") continue;
    const Eigen::Map<const Eigen::VectorXf> rest(residual.data() + block.offset, block.size);
    square[block.capture] += rest.squaredNorm();
    known[block.capture] += static_cast<double>((rest.array() != 0).count());
  }
  std::vector<double> left;
  for (int c = 0; c < layout.captures; ++c)
    if (known[c] > 0) left.push_back(square[c] / known[c]);
  if (left.empty()) return 0;
  const auto middle = left.begin() + static_cast<std::ptrdiff_t>(left.size() / 2);
  std::ranges::nth_element(left, middle);
  return *middle;
}

}  // namespace binrig
