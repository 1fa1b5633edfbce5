#include "core/spectrum.h"

#include <fftw3.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <numbers>
#include <sstream>
#include <tuple>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "core/recent_fields.h"
#include "core/recording_writer.h"

namespace binrig {

namespace {

// FFTW's planner is the one part of it that is not thread-safe.
std::mutex& planner_mutex() {
  static std::mutex mutex;
  return mutex;
}

std::filesystem::path wisdom_path() {
  const char* cache = std::getenv("XDG_CACHE_HOME");
  const char* home = std::getenv("HOME");
  if (cache != nullptr && *cache != '\0') return std::filesystem::path(cache) / "binrig" / "fftwf-wisdom";
  if (home != nullptr && *home != '\0') return std::filesystem::path(home) / ".cache" / "binrig" / "fftwf-wisdom";
  return {};
}

void read_wisdom_once() {
  static const bool done = [] {
    const auto path = wisdom_path();
    if (!path.empty()) fftwf_import_wisdom_from_filename(path.c_str());
    return true;
  }();
  static_cast<void>(done);
}

// A cache that cannot be written costs planning time in the next run and nothing else.
void keep_wisdom() {
  const auto path = wisdom_path();
  if (path.empty()) return;
  std::error_code ignored;
  std::filesystem::create_directories(path.parent_path(), ignored);
  fftwf_export_wisdom_to_filename(path.c_str());
}

bool aligned(const void* data) { return fftwf_alignment_of(static_cast<float*>(const_cast<void*>(data))) == 0; }

// Averages rows over the cells of a new grid: integrates the piecewise linear, periodic interpolant of the samples over
// each new cell and divides by the cell's width. Sums over a period are kept exactly.
cv::Mat average_rows(const cv::Mat& samples, int to) {
  const int from = samples.rows;
  cv::Mat result = cv::Mat::zeros(to, samples.cols, CV_64F);
  const double ratio = static_cast<double>(from) / to;
  // Integral of the hat function around 0, from -1 to t.
  const auto hat_integral = [](double t) {
    if (t <= -1) return 0.0;
    if (t <= 0) return 0.5 * (1 + t) * (1 + t);
    if (t <= 1) return 1 - 0.5 * (1 - t) * (1 - t);
    return 1.0;
  };
  for (int k = 0; k < to; ++k) {
    const double low = (k - 0.5) * ratio, high = (k + 0.5) * ratio;
    for (int j = static_cast<int>(std::floor(low)); j <= static_cast<int>(std::ceil(high)); ++j) {
      const double weight = (hat_integral(high - j) - hat_integral(low - j)) / ratio;
      if (weight > 0) result.row(k) += weight * samples.row(((j % from) + from) % from);
    }
  }
  return result;
}

// The whole plane from the half plane.
cv::Mat full_plane(const cv::Mat& psd, int cols) {
  cv::Mat full(psd.rows, cols, CV_64F);
  for (int row = 0; row < psd.rows; ++row) {
    const int mirrored = (psd.rows - row) % psd.rows;
    for (int col = 0; col < cols; ++col) {
      full.at<double>(row, col) = col < psd.cols ? psd.at<double>(row, col) : psd.at<double>(mirrored, cols - col);
    }
  }
  return full;
}

// How many frequencies of the whole plane a sample of the half plane stands for.
double multiplicity(int col, int cols) { return col == 0 || 2 * col == cols ? 1.0 : 2.0; }

}  // namespace

struct Fft2::Plans {
  fftwf_plan forward = nullptr, inverse = nullptr;

  Plans(int rows, int cols, bool measured) {
    const std::size_t reals = static_cast<std::size_t>(rows) * cols;
    const std::size_t complexes = static_cast<std::size_t>(rows) * (cols / 2 + 1);
    float* image = fftwf_alloc_real(reals);
    fftwf_complex* spectrum = fftwf_alloc_complex(complexes);
    const unsigned effort = measured ? FFTW_MEASURE : FFTW_ESTIMATE;
    if (measured) read_wisdom_once();
    if (image != nullptr && spectrum != nullptr) {
      forward = fftwf_plan_dft_r2c_2d(rows, cols, image, spectrum, effort);
      inverse = fftwf_plan_dft_c2r_2d(rows, cols, spectrum, image, effort | FFTW_DESTROY_INPUT);
    }
    fftwf_free(image);
    fftwf_free(spectrum);
    if (forward == nullptr || inverse == nullptr)
      throw Error(fmt::format("no DFT of {} x {} pixels can be planned", rows, cols));
    if (measured) keep_wisdom();
  }
  ~Plans() {
    const std::lock_guard lock(planner_mutex());
    if (forward != nullptr) fftwf_destroy_plan(forward);
    if (inverse != nullptr) fftwf_destroy_plan(inverse);
  }
};

Fft2::Fft2(int rows, int cols, bool measured) : rows_(rows), cols_(cols) {
  if (rows < 1 || cols < 1) throw Error(fmt::format("a DFT needs at least one pixel, not {} x {}", rows, cols));
  // Plans live as long as the program: sizes are few, and a plan holds no image. The map is leaked on purpose, so that
  // no thread meets a destroyed one at the program's end.
  static auto& plans = *new std::map<std::tuple<int, int, bool>, std::shared_ptr<const Plans>>;
  const std::lock_guard lock(planner_mutex());
  auto& shared = plans[{rows, cols, measured}];
  if (!shared) shared = std::make_shared<const Plans>(rows, cols, measured);
  plans_ = shared;
}

void Fft2::forward(const cv::Mat& image, std::vector<std::complex<float>>& spectrum) const {
  if (image.type() != CV_32F || image.rows != rows_ || image.cols != cols_)
    throw Error(fmt::format("the DFT was planned for a float image of {} x {}, not {} x {}", rows_, cols_, image.rows,
                            image.cols));
  spectrum.resize(static_cast<std::size_t>(rows_) * half_cols());
  const cv::Mat input = image.isContinuous() && aligned(image.data) ? image : image.clone();
  fftwf_execute_dft_r2c(plans_->forward, reinterpret_cast<float*>(input.data),
                        reinterpret_cast<fftwf_complex*>(spectrum.data()));
}

void Fft2::inverse(std::vector<std::complex<float>>& spectrum, cv::Mat& image) const {
  if (spectrum.size() != static_cast<std::size_t>(rows_) * half_cols())
    throw Error(fmt::format("the inverse DFT wants {} x {} coefficients, not {}", rows_, half_cols(), spectrum.size()));
  image.create(rows_, cols_, CV_32F);
  cv::Mat output = image.isContinuous() && aligned(image.data) ? image : cv::Mat(rows_, cols_, CV_32F);
  fftwf_execute_dft_c2r(plans_->inverse, reinterpret_cast<fftwf_complex*>(spectrum.data()),
                        reinterpret_cast<float*>(output.data));
  if (output.data != image.data) output.copyTo(image);  // where the caller has it, which may be a piece of an array
}

const std::vector<int>& FrequencyBins::of(int rows, int cols) {
  const std::lock_guard lock(guard_);
  const auto [at, fresh] = known_.try_emplace({rows, cols});
  if (fresh)
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < cols / 2 + 1; ++j) at->second.push_back(rule_(i, j, rows, cols));
  return at->second;
}

NoiseSpectrum::NoiseSpectrum(cv::Mat psd, int cols) : psd_(std::move(psd)), cols_(cols) {
  if (psd_.type() != CV_64F || psd_.rows < 1 || psd_.cols != cols / 2 + 1)
    throw Error(
        fmt::format("a spectrum of {} columns holds doubles in rows of {}, not of {}", cols, cols / 2 + 1, psd_.cols));
  for (int row = 0; row < psd_.rows; ++row) {
    for (int col = 0; col < psd_.cols; ++col) {
      const double value = psd_.at<double>(row, col);
      if (!std::isfinite(value) || value < 0)
        throw Error(fmt::format("the spectral density at row {}, column {} is {}, which no power can be", row, col,
                                number_text(value)));
    }
  }
}

double NoiseSpectrum::variance_mm2() const {
  double sum = 0;
  for (int row = 0; row < psd_.rows; ++row)
    for (int col = 0; col < psd_.cols; ++col) sum += multiplicity(col, cols_) * psd_.at<double>(row, col);
  return empty() ? 0 : sum / (static_cast<double>(psd_.rows) * cols_);
}

double NoiseSpectrum::at(double fx, double fy) const {
  const auto sample = [&](int row, int col) {
    row = ((row % rows()) + rows()) % rows();
    col = ((col % cols_) + cols_) % cols_;
    return col < psd_.cols ? psd_.at<double>(row, col) : psd_.at<double>((rows() - row) % rows(), cols_ - col);
  };
  const double x = fx * cols_, y = fy * rows();
  const int col = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
  const double a = x - col, b = y - row;
  return (1 - b) * ((1 - a) * sample(row, col) + a * sample(row, col + 1)) +
         b * ((1 - a) * sample(row + 1, col) + a * sample(row + 1, col + 1));
}

NoiseSpectrum NoiseSpectrum::resampled(int new_rows, int new_cols) const {
  if (new_rows == rows() && new_cols == cols_) return *this;
  // Cell averages, not samples: a narrow ridge must not fall between the frequencies of a coarser grid.
  const cv::Mat rows_done = average_rows(full_plane(psd_, cols_), new_rows);
  const cv::Mat remapped = average_rows(rows_done.t(), new_cols).t();
  cv::Mat half = remapped.colRange(0, new_cols / 2 + 1).clone();
  // Symmetric to the last bit, and never negative by rounding.
  for (int col : {0, new_cols / 2}) {
    if (multiplicity(col, new_cols) != 1.0) continue;
    for (int row = 1; row < (new_rows + 1) / 2; ++row) {
      const double mean = 0.5 * (half.at<double>(row, col) + half.at<double>(new_rows - row, col));
      half.at<double>(row, col) = half.at<double>(new_rows - row, col) = mean;
    }
  }
  half = cv::max(half, 0.0);
  NoiseSpectrum result(half, new_cols);
  result.provenance = provenance;
  return result;
}

NoiseSpectrum NoiseSpectrum::scaled_to(double sigma_mm) const {
  const double variance = variance_mm2();
  if (!(sigma_mm >= 0) || (variance <= 0 && sigma_mm > 0))
    throw Error(fmt::format("a spectrum of variance {} mm2 cannot be scaled to a standard deviation of {} mm",
                            number_text(variance), number_text(sigma_mm)));
  NoiseSpectrum result(variance > 0 ? cv::Mat(psd_ * (sigma_mm * sigma_mm / variance)) : psd_.clone(), cols_);
  result.provenance = provenance;
  return result;
}

std::vector<double> NoiseSpectrum::radial(int bins) const {
  std::vector<double> sum(bins, 0.0), count(bins, 0.0);
  for (int row = 0; row < psd_.rows; ++row) {
    const double fy = dft_frequency(row, rows());
    for (int col = 0; col < psd_.cols; ++col) {
      const int ring = static_cast<int>(2.0 * bins * std::hypot(fy, static_cast<double>(col) / cols_));
      if (ring >= bins) continue;
      sum[ring] += multiplicity(col, cols_) * psd_.at<double>(row, col);
      count[ring] += multiplicity(col, cols_);
    }
  }
  for (int ring = 0; ring < bins; ++ring) {
    if (count[ring] > 0) {
      sum[ring] /= count[ring];
      continue;
    }
    // A ring between the grid's frequencies: interpolated along its middle.
    const double f = (ring + 0.5) / (2.0 * bins);
    for (int k = 0; k < 64; ++k) {
      const double angle = std::numbers::pi * k / 64;
      sum[ring] += at(f * std::cos(angle), f * std::sin(angle)) / 64;
    }
  }
  return sum;
}

NoiseSpectrum NoiseSpectrum::parametric(int rows, int cols, double sigma_mm, double correlation_length_px,
                                        double white_share) {
  cv::Mat psd(rows, cols / 2 + 1, CV_64F);
  double sum = 0;
  for (int row = 0; row < rows; ++row) {
    const double fy = dft_frequency(row, rows);
    for (int col = 0; col < psd.cols; ++col) {
      const double fx = static_cast<double>(col) / cols;
      const double a = 2 * std::numbers::pi * correlation_length_px;
      const double g = std::exp(-a * a * (fx * fx + fy * fy));
      psd.at<double>(row, col) = g;
      sum += multiplicity(col, cols) * g;
    }
  }
  const double mean = sum / (static_cast<double>(rows) * cols);
  psd = ((1 - white_share) / mean * psd + white_share) * (sigma_mm * sigma_mm);
  return NoiseSpectrum(psd, cols);
}

NoiseSpectrum NoiseSpectrum::read(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw Error("the noise spectrum " + path + " cannot be read");
  std::string detail;
  try {
    const auto json = nlohmann::json::parse(file);
    const int rows = json.at("rows").get<int>(), cols = json.at("cols").get<int>();
    const auto& lines = json.at("psd_mm2_px2");
    if (rows < 1 || cols < 1 || rows > 16384 || cols > 16384 || lines.size() != static_cast<std::size_t>(rows))
      throw Error(fmt::format("{}: rows is {} but psd_mm2_px2 has {}", path, rows, lines.size()));
    cv::Mat psd(rows, cols / 2 + 1, CV_64F);
    for (int row = 0; row < rows; ++row) {
      const auto values = lines[row].get<std::vector<double>>();
      if (values.size() != static_cast<std::size_t>(psd.cols))
        throw Error(fmt::format("{}: row {} of psd_mm2_px2 has {} values, not {}", path, row, values.size(), psd.cols));
      std::copy(values.begin(), values.end(), psd.ptr<double>(row));
    }
    NoiseSpectrum spectrum;
    try {
      spectrum = NoiseSpectrum(psd, cols);
    } catch (const Error& error) {
      throw Error(path + ": " + error.what());
    }
    spectrum.provenance = json.value("provenance", "");
    if (json.contains("camera")) {
      spectrum.camera_width = json.at("camera").at(0).get<int>();
      spectrum.camera_height = json.at("camera").at(1).get<int>();
    }
    return spectrum;
  } catch (const nlohmann::json::exception& error) {
    throw Error(path + " is not a noise spectrum: " + error.what());
  }
}

void NoiseSpectrum::write(const std::string& path, const std::string& made_from) const {
  // Seven digits a number: spectra are known to a percent at best.
  std::string text = fmt::format(
      "{{\"kind\": \"noise spectrum\", \"provenance\": {},\n{}\"rows\": {}, \"cols\": {}, \"sigma_mm\": {:.7g},\n"
      "\"meaning\": \"power spectral density in mm^2 px^2; row k has the frequency k/rows (k > rows/2: k/rows - 1), "
      "column "
      "j has j/cols cycles per pixel; the mean over the whole plane is the variance\",\n\"psd_mm2_px2\": [\n",
      nlohmann::json(made_from).dump(),
      camera_width > 0 ? fmt::format("\"camera\": [{}, {}],\n", camera_width, camera_height) : "", rows(), cols_,
      std::sqrt(variance_mm2()));
  for (int row = 0; row < rows(); ++row) {
    text += '[';
    for (int col = 0; col < psd_.cols; ++col)
      text += fmt::format("{}{:.7g}", col > 0 ? "," : "", psd_.at<double>(row, col));
    text += row + 1 < rows() ? "],\n" : "]\n";
  }
  text += "]}\n";
  write_file_atomically(path, text);
}

NoiseSynthesis::NoiseSynthesis(const NoiseSpectrum& spectrum, bool rayleigh)
    : fft_(spectrum.rows(), spectrum.cols()), rayleigh_(rayleigh) {
  // |X|^2 = N S for the unnormalised DFT of N pixels; the inverse's missing 1/N is put in here.
  const double pixels = static_cast<double>(spectrum.rows()) * spectrum.cols();
  magnitude_.resize(static_cast<std::size_t>(spectrum.rows()) * fft_.half_cols());
  for (int row = 0; row < spectrum.rows(); ++row)
    for (int col = 0; col < fft_.half_cols(); ++col)
      magnitude_[static_cast<std::size_t>(row) * fft_.half_cols() + col] =
          static_cast<float>(std::sqrt(spectrum.psd().at<double>(row, col) / pixels));
  if (!rayleigh) magnitude_[0] = 0;  // one magnitude with either sign would only move every frame by the same step
  const auto* bytes = reinterpret_cast<const char*>(magnitude_.data());
  key_ = mix_keys(hash_text({bytes, magnitude_.size() * sizeof(float)}), mix_keys(fft_.cols(), rayleigh));
}

cv::Mat NoiseSynthesis::recent(const RandomStream& stream) const {
  return recent_field(key_, stream, [&](cv::Mat& noise_mm) { synthesise(stream, noise_mm); });
}

void NoiseSynthesis::synthesise(const RandomStream& stream, cv::Mat& noise_mm) const {
  const int rows = fft_.rows(), cols = fft_.cols(), half = fft_.half_cols();
  // Kept from frame to frame: fresh memory of this size costs as much as a fifth of the DFT.
  thread_local std::vector<std::complex<float>> kept_spectrum;
  thread_local cv::Mat kept_draws;
  kept_spectrum.resize(magnitude_.size());
  kept_draws.create(rows, half, CV_32F);
  auto& spectrum = kept_spectrum;
  cv::Mat& draws = kept_draws;
  // A draw of 24 bits: 12 for the phase, 12 for the magnitude. 4096 of each are as good as a continuum here: the
  // inverse DFT adds hundreds of thousands of them.
  constexpr int steps = 4096, band_rows = 16;
  static const std::vector<std::complex<float>> circle = [] {
    std::vector<std::complex<float>> table(steps);
    for (int k = 0; k < steps; ++k)
      table[k] = std::complex<float>(std::polar(1.0, 2 * std::numbers::pi * (k + 0.5) / steps));
    return table;
  }();
  // Quantiles of Rayleigh's distribution with mean square 1.
  static const std::vector<float> radius = [] {
    std::vector<double> table(steps);
    double square = 0;
    for (int k = 0; k < steps; ++k) {
      table[k] = -std::log((k + 0.5) / steps);
      square += table[k] / steps;
    }
    std::vector<float> roots(steps);
    for (int k = 0; k < steps; ++k) roots[k] = static_cast<float>(std::sqrt(table[k] / square));
    return roots;
  }();
  stream.fill_uniform(draws);
  const float *draw = draws.ptr<float>(), *magnitude = magnitude_.data(), *radii = radius.data();
  const std::complex<float>* directions = circle.data();
  std::complex<float>* out = spectrum.data();
  parallel_for((rows + band_rows - 1) / band_rows, [&, draw, magnitude, radii, directions, out](int band) {
    const std::size_t begin = static_cast<std::size_t>(band) * band_rows * half,
                      end = static_cast<std::size_t>(std::min(rows, (band + 1) * band_rows)) * half;
    for (std::size_t k = begin; k < end; ++k) {
      const int bits = static_cast<int>(draw[k] * 0x1.0p24f);
      const float m = rayleigh_ ? magnitude[k] * radii[bits & (steps - 1)] : magnitude[k];
      out[k] = m * directions[bits >> 12];
    }
  });
  // A real field: in the columns that are their own mirror, row -k is the conjugate of row k, and what mirrors onto
  // itself is real.
  for (int col : {0, cols / 2}) {
    if (multiplicity(col, cols) != 1.0) continue;
    for (int row = 1; row < (rows + 1) / 2; ++row)
      spectrum[static_cast<std::size_t>(rows - row) * half + col] =
          std::conj(spectrum[static_cast<std::size_t>(row) * half + col]);
    for (int row : {0, rows / 2}) {
      if (row != 0 && 2 * row != rows) continue;
      auto& own = spectrum[static_cast<std::size_t>(row) * half + col];
      own = rayleigh_ ? own.real() * std::numbers::sqrt2_v<float> : std::copysign(std::abs(own), own.real());
    }
  }
  fft_.inverse(spectrum, noise_mm);
}

}  // namespace binrig
