#include "compare/value_steps.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <functional>

#include "core/spectrum.h"

namespace binrig {
namespace {

constexpr int depth_size = 1 << 19, disparity_size = 1 << 20;
constexpr double depth_bin_mm = 0.01, disparity_bin_px = 1.0 / 2048;  // as far as 5.2 m and 512 px

constexpr double fewest_values = 1000;
constexpr double beyond_chance = 2;  // times the strongest line of chance: neighbouring pixels say the same
constexpr double after_a_dip = 1.2;  // times the weakest line of lower frequency: else it is the slope down from zero
constexpr double unusual = 1.5;      // times the strongest line nearby of usual values
constexpr double as_strong = 0.8;    // of a multiple's line, to be its fundamental
constexpr double in_phase = 0.9;  // of a line's modulus, to be of whole multiples of the step; of all values, of exact
constexpr double twice_storage = 0.64;  // modulus of a step's line after storage in halves of it: sinc(1/2) = 2 / pi

/// Lines of a histogram.
class Lines {
 public:
  Lines(const std::vector<std::uint32_t>& counts, double bin) : histogram_(counts.begin(), counts.end()), bin_(bin) {
    const int n = static_cast<int>(counts.size());
    std::vector<std::complex<float>> line;
    Fft2(1, n).forward(cv::Mat(1, n, CV_32F, histogram_.data()), line);
    total_ = line[0].real();
    for (const std::complex<float> l : line) modulus_.push_back(std::abs(l));
  }

  /// `storage`: of the values, 0 = none is known.
  std::vector<ReadStep> steps(double finest, double coarsest, int most, const Lines& usual, double storage) const {
    if (total_ < fewest_values) return {};
    if (storage > 0) finest = std::max(finest, 1.02 * storage);  // below lies the storage's own line
    const double length = bin_ * static_cast<double>(histogram_.size());
    const int low = std::max(4, static_cast<int>(length / coarsest));
    const int high = std::min(static_cast<int>(modulus_.size()) - 4, static_cast<int>(length / finest));
    const std::vector<int> peaks = peaks_between(low, high, usual);
    // The lines of flat targets at a few distances meet at low frequencies, too; what comes after the rounding weakens
    // its line. So the strongest in all, and those that stand out most, in turn.
    std::vector<int> strongest = peaks, clearest = peaks;
    std::ranges::stable_sort(strongest, std::greater(), [&](int line) { return modulus_[line]; });
    const std::vector<double> contrast = contrasts();
    std::ranges::stable_sort(clearest, std::greater(), [&](int line) { return contrast[line]; });
    std::vector<int> lines;
    for (std::size_t k = 0; k < peaks.size() && static_cast<int>(lines.size()) < most; ++k)
      for (const int peak : {strongest[k], clearest[k]}) {
        const int line = fundamental(peak, low);
        if (std::ranges::find(lines, line) == lines.end()) lines.push_back(line);
      }
    lines.resize(std::min(lines.size(), static_cast<std::size_t>(most)));
    // Values that are whole multiples of the storage's step see no difference between f and 1 / storage - f.
    for (std::size_t k = 0, read = lines.size(); storage > 0 && k < read; ++k) {
      const int mirrored = static_cast<int>(std::lround(length / storage)) - lines[k];
      if (modulus_[lines[k]] < twice_storage * total_ && mirrored > low && mirrored <= high &&
          std::ranges::find(lines, mirrored) == lines.end())
        lines.push_back(mirrored);
    }
    std::vector<ReadStep> result;
    for (const int line : lines) {
      const double refined_line = refined(line), step = length / refined_line;
      result.push_back(
          {step, step * step / (2 * bin_ * typical_value()), in_phase_at(refined_line) > in_phase * total_});
    }
    return result;
  }

 private:
  /// By frequency.
  std::vector<int> peaks_between(int low, int high, const Lines& usual) const {
    // The strongest of n lines of pure chance has a squared modulus of (ln n + 0.58) times the number of values.
    const double chance = std::sqrt((std::log(high - low + 1) + 0.58) * total_);
    std::vector<int> peaks;
    float weakest = *std::min_element(modulus_.begin(), modulus_.begin() + low);
    for (int k = low; k <= high; ++k) {
      const float here = modulus_[k];
      weakest = std::min(weakest, here);
      if (here > beyond_chance * chance && here > after_a_dip * weakest &&
          here == *std::max_element(modulus_.begin() + k - 3, modulus_.begin() + k + 4) &&
          here / total_ > unusual * usual.strongest_about(k))
        peaks.push_back(k);
    }
    return peaks;
  }

  /// As a share of all values: 1 = all are whole multiples of the step, but for an offset.
  double strongest_about(int line) const {
    constexpr double about = 1.1;  // frequencies, as a ratio
    const auto first = static_cast<int>(line / about), last = std::min<int>(line * about, modulus_.size() - 1);
    return total_ > 0 ? *std::max_element(modulus_.begin() + first, modulus_.begin() + last + 1) / total_ : 0;
  }

  /// Of each line's modulus to the mean of those nearby.
  std::vector<double> contrasts() const {
    constexpr double nearby = 1.3;  // frequencies, as a ratio
    std::vector<double> sum(modulus_.size() + 1, 0), result(modulus_.size(), 0);
    for (std::size_t k = 0; k < modulus_.size(); ++k) sum[k + 1] = sum[k] + modulus_[k];
    for (std::size_t k = 1; k < modulus_.size(); ++k) {
      const auto from = static_cast<std::size_t>(static_cast<double>(k) / nearby);
      const auto to = std::min(static_cast<std::size_t>(static_cast<double>(k) * nearby) + 1, modulus_.size());
      result[k] = modulus_[k] * static_cast<double>(to - from) / (sum[to] - sum[from]);
    }
    return result;
  }

  /// The lowest line of which a line is a multiple, if that and all other multiples up to it are about as strong; else
  /// the line itself. (The step's own line may be no more than usual, where flat targets are at few distances.)
  int fundamental(int of, int low) const {
    const auto strong = [&](int line) {
      return *std::max_element(modulus_.begin() + line - 1, modulus_.begin() + line + 2) >= as_strong * modulus_[of];
    };
    for (int times = of / low; times >= 2; --times) {
      const double first = static_cast<double>(of) / times;
      int k = 1;
      while (k < times && strong(static_cast<int>(std::lround(k * first)))) ++k;
      if (k == times) return static_cast<int>(std::lround(first));
    }
    return of;
  }

  /// A line's place between bins: where the values are whole multiples of a step, if that is about as strong; else the
  /// peak of the modulus.
  double refined(int line) const {
    constexpr int tries = 24;  // to either side, of half a turn of the phase
    const double mean = typical_value();
    const double reach = mean > 0 ? std::max(0.5, 0.5 * static_cast<double>(histogram_.size()) / mean) : 0.5;
    std::vector<double> real;
    for (int k = -tries; k <= tries; ++k) real.push_back(in_phase_at(line + reach * k / tries));
    const auto best = std::clamp<std::ptrdiff_t>(std::ranges::max_element(real) - real.begin(), 1, 2 * tries - 1);
    if (real[best] >= in_phase * modulus_[line])
      return line +
             reach / tries * (static_cast<double>(best - tries) + summit(real[best - 1], real[best], real[best + 1]));
    return line + summit(modulus_[line - 1], modulus_[line], modulus_[line + 1]);
  }

  /// Of the parabola through three neighbours of which the middle one is highest: how far from it.
  static double summit(double before, double here, double after) {
    const double bend = before - 2 * here + after;
    return bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
  }

  double typical_value() const {  // in bins
    double sum = 0;
    for (std::size_t i = 0; i < histogram_.size(); ++i) sum += static_cast<double>(i) * histogram_[i];
    return sum / total_;
  }

  /// Real part of a line, also between two of the DFT.
  double in_phase_at(double line) const {
    double sum = 0;
    const double turn = 2 * CV_PI * line / static_cast<double>(histogram_.size());
    for (std::size_t i = 0; i < histogram_.size(); ++i)
      if (histogram_[i] > 0) sum += histogram_[i] * std::cos(turn * static_cast<double>(i));
    return sum;
  }

  std::vector<float> histogram_;
  double bin_;
  double total_ = 0;
  std::vector<float> modulus_;
};

void count(std::vector<std::uint32_t>& histogram, double value, double bin) {
  const double place = value / bin + 0.5;
  if (place < static_cast<double>(histogram.size())) ++histogram[static_cast<std::size_t>(place)];
}

}  // namespace

ValueSteps::ValueSteps() : depth_(depth_size, 0), disparity_(disparity_size, 0) {}

void ValueSteps::add(const Frame& frame, double focal_baseline) {
  storage_mm_ = std::max(storage_mm_, frame.depth_scale_mm);
  for (int row = 0; row < frame.depth_mm.rows; ++row) {
    const float* z = frame.depth_mm.ptr<float>(row);
    for (int col = 0; col < frame.depth_mm.cols; ++col) {
      if (z[col] <= 0) continue;
      count(depth_, z[col], depth_bin_mm);
      if (focal_baseline > 0) count(disparity_, focal_baseline / z[col], disparity_bin_px);
    }
  }
}

std::vector<ReadStep> ValueSteps::depth_mm(double finest, double coarsest, int most, const ValueSteps& usual) const {
  return Lines(depth_, depth_bin_mm).steps(finest, coarsest, most, Lines(usual.depth_, depth_bin_mm), storage_mm_);
}

std::vector<ReadStep> ValueSteps::disparity_px(double finest, double coarsest, int most,
                                               const ValueSteps& usual) const {
  return Lines(disparity_, disparity_bin_px)
      .steps(finest, coarsest, most, Lines(usual.disparity_, disparity_bin_px), 0);
}

}  // namespace binrig
