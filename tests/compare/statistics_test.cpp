// Every segment on constructed frames whose statistics are known.
#include "compare/statistic.h"

#include <cmath>
#include <functional>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "compare/probability.h"
#include "core/error.h"
#include "core/random.h"

namespace binrig {
namespace {

constexpr int width = 160, height = 120;
constexpr double distance_mm = 800, focal_baseline = 113400;

StatisticContext context(int frames, TargetKind target = TargetKind::plane) {
  StatisticContext c;
  c.capture = {"train", 1, "constructed", target, frames, false};
  c.frames = frames;
  c.camera = camera_from_field_of_view(width, height, 0.28);
  c.focal_baseline = focal_baseline;
  return c;
}

/// A frontal plane; right of `edge_col` it lies 50 mm further away.
std::shared_ptr<Channels> scene(int edge_col = -1) {
  auto c = std::make_shared<Channels>();
  c->camera = context(1).camera;
  c->depth_mm = cv::Mat(height, width, CV_32F, cv::Scalar(distance_mm));
  c->cos_incidence = cv::Mat(height, width, CV_32F, cv::Scalar(1));
  c->edge_px = cv::Mat(height, width, CV_32F, cv::Scalar(64));
  if (edge_col >= 0)
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u) {
        if (u > edge_col) c->depth_mm.at<float>(v, u) = distance_mm + 50;
        c->edge_px.at<float>(v, u) = std::min(64.f, std::abs(u - edge_col - 0.5f));
      }
  return c;
}

using PixelRule = std::function<float(int frame, int row, int col, float perfect, const cv::Mat& normal)>;

/// Statistics of frames whose depth is rule(...); 0 = a hole. `normal` are standard normal numbers of the frame.
std::vector<RawStatistic> statistics_of(int frames, const PixelRule& rule,
                                        std::shared_ptr<const Channels> channels = scene(),
                                        TargetKind target = TargetKind::plane) {
  CaptureStatistics statistics(context(frames, target));
  for (int t = 0; t < frames; ++t) {
    cv::Mat normal(height, width, CV_32F);
    RandomStream(77).child(static_cast<std::uint64_t>(t)).fill_normal(normal);
    Frame frame;
    frame.camera = channels->camera;
    frame.depth_mm.create(height, width, CV_32F);
    frame.reason = cv::Mat::zeros(height, width, CV_8U);
    for (int v = 0; v < height; ++v)
      for (int u = 0; u < width; ++u) {
        const float z = rule(t, v, u, channels->depth_mm.at<float>(v, u), normal);
        frame.depth_mm.at<float>(v, u) = z;
        if (z == 0) frame.reason.at<std::uint8_t>(v, u) = static_cast<std::uint8_t>(Reason::unknown);
      }
    statistics.add(frame, channels);
  }
  return statistics.finish();
}

const RawStatistic& of(const std::vector<RawStatistic>& all, const std::string& name) {
  for (std::size_t i = 0; i < segments().size(); ++i)
    if (segments()[i].name == name) return all[i];
  throw Error("no segment " + name);
}

TEST(Statistics, NamesAreFoundAndNearMissesNamed) {
  EXPECT_EQ(segment("bias").group, "bias");
  try {
    segment("noize");
    FAIL();
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find("noise"), std::string::npos);
  }
}

TEST(Statistics, BiasIsTheMeanResidualOfABin) {
  const auto raw =
      of(statistics_of(3, [](int, int, int col, float z, const cv::Mat&) { return z + 0.01f * col; }), "bias");
  ASSERT_EQ(raw.side_px, 2);
  for (int i = 0; i < raw.cols * raw.rows; ++i) {
    EXPECT_GT(raw.weight[i], 0);
    const double col = 2.0 * (i % raw.cols) + 0.5;
    EXPECT_NEAR(raw.value[i], 0.01 * col, 2e-4);  // float depth at 800 mm: 6e-5
  }
}

TEST(Statistics, NoiseIsTheVarianceOfTheRandomPartAndBlindToBias) {
  const auto raw = of(statistics_of(8, [](int, int row, int col, float z,
                                          const cv::Mat& n) { return z + 0.02f * col + 0.3f * n.at<float>(row, col); }),
                      "noise");
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < raw.value.size(); ++i) sum += raw.value[i] * raw.weight[i], count += raw.weight[i];
  // 134000 differences in 7 overlapping pairs: relative error about sqrt(3 / 134000) = 0.005.
  EXPECT_NEAR(sum / count, 0.09, 0.09 * 0.02);
}

TEST(Statistics, FlickerBetweenTwoStepsOfDepthIsNoiseHoweverRareOneOfThemIs) {
  constexpr double step_mm = 1.3;
  for (const double share : {0.5, 0.3, 0.1, 0.02}) {  // of the further step: the residuals' quartiles may be equal
    const double beyond = normal_quantile(1 - share);
    const auto raw = of(statistics_of(8,
                                      [&](int, int row, int col, float z, const cv::Mat& n) {
                                        return n.at<float>(row, col) > beyond ? z + static_cast<float>(step_mm) : z;
                                      }),
                        "noise");
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < raw.value.size(); ++i) sum += raw.value[i] * raw.weight[i], count += raw.weight[i];
    const double expected = share * (1 - share) * step_mm * step_mm;
    // Half the square of a difference is step^2 / 2 with probability 2 share (1 - share), else 0: four standard errors,
    // pairs that share a frame counted as one.
    const double flips = 2 * share * (1 - share);
    EXPECT_NEAR(sum / count, expected, expected * 4 * std::sqrt((1 - flips) / flips / (0.5 * count))) << share;
  }
}

TEST(Statistics, ASingleFrameGivesItsSpatialDifferenceAndSaysSo) {
  const auto all = statistics_of(
      1, [](int, int row, int col, float z, const cv::Mat& n) { return z + 0.3f * n.at<float>(row, col); });
  const auto& raw = of(all, "noise");
  EXPECT_TRUE(raw.spatial);
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < raw.value.size(); ++i) sum += raw.value[i] * raw.weight[i], count += raw.weight[i];
  EXPECT_NEAR(sum / count, 0.09, 0.09 * 0.06);  // 19000 samples
  EXPECT_TRUE(of(all, "time").value.empty());
}

TEST(Statistics, DropOutIsTheShareOfHolesAndNothingOutsideTheSceneCounts) {
  auto channels = scene();
  channels->depth_mm(cv::Rect(0, 0, width / 2, height)).setTo(0);
  const auto raw = of(statistics_of(
                          2,
                          [](int, int, int col, float, const cv::Mat&) {
                            return col < width / 2 || col % 4 == 0 ? 0.f : static_cast<float>(distance_mm);
                          },
                          channels),
                      "drop-out");
  for (int i = 0; i < raw.rows * raw.cols; ++i) {
    const bool inside = (i % raw.cols) * raw.side_px >= width / 2;
    EXPECT_EQ(raw.weight[i] > 0, inside);
    if (inside) {
      EXPECT_NEAR(raw.value[i], 0.25, 1e-6);
    }
  }
}

TEST(Statistics, PixelsOutsideTheValidRegionCountNowhere) {
  StatisticContext c = context(1);
  c.valid_region = cv::Mat::zeros(height, width, CV_8U);
  CaptureRegions regions(*scene(), c);
  EXPECT_EQ(cv::countNonZero(regions.counted), 0);
  EXPECT_EQ(cv::countNonZero(CaptureRegions(*scene(), context(1)).counted), width * height);
}

TEST(Statistics, EdgesSeeTheForegroundGrow) {
  const int edge = 79;
  const auto exact =
      of(statistics_of(
             2, [](int, int, int, float z, const cv::Mat&) { return z; }, scene(edge), TargetKind::scene),
         "edges");
  const auto fat = of(statistics_of(
                          2,
                          [](int, int, int col, float z, const cv::Mat&) {
                            return col > edge && col <= edge + 2 ? static_cast<float>(distance_mm) : z;
                          },
                          scene(edge), TargetKind::scene),
                      "edges");
  // The background lies to the right: orientation 0; bins 4 and 5 are the first two background pixels.
  for (int bin = 0; bin < edge_bins; ++bin) {
    ASSERT_GT(exact.weight[bin], 0);
    EXPECT_NEAR(exact.value[bin], bin < 4 ? 0 : 1, 1e-5);
    EXPECT_NEAR(fat.value[bin], bin < 6 ? 0 : 1, 1e-5);
  }
  for (int bin = edge_bins; bin < 4 * edge_bins; ++bin) EXPECT_EQ(exact.weight[bin], 0) << "no such edge is there";
}

TEST(Statistics, OneOutlierBesideAnEdgeIsNoJitter) {
  const auto jitter_with = [](bool outlier) {
    const auto edges = of(statistics_of(
                              4,
                              [&](int frame, int row, int col, float z, const cv::Mat& normal) {
                                const bool hit = outlier && frame == 2 && row == 60 && col == 79;
                                return z + 0.2f * normal.at<float>(row, col) + (hit ? 25.f : 0.f);
                              },
                              scene(79), TargetKind::scene),
                          "edges");
    const int at = 4 * edge_bins + 3;  // of the foreground's last pixel
    EXPECT_GT(edges.weight[at], 300);
    return segment("edges").stabilise(edges.value[at], edges.weight[at], at, static_cast<int>(edges.value.size()));
  };
  // 360 pairs of frames jitter by 0.2 mm of 50 mm; two of them are half the step apart: 2 * 0.5 / 360 in the mean.
  const double plain = 0.2 / 50 * 2 / std::sqrt(3.14159265), with = plain + 2 * 0.5 / 360;
  EXPECT_NEAR(jitter_with(true) - jitter_with(false), 0.5 * std::log((with + 1e-3) / (plain + 1e-3)), 0.03);
}

TEST(Statistics, SharesScatterAlikeWhereverTheyLie) {
  // Anscombe: the variance is 1/(4 (count + 1/2)) for any but the rarest events. Binomial draws, exactly summed.
  for (const int count : {48, 64, 320})
    for (const double share : {0.02, 0.1, 0.5, 0.9}) {
      double mean = 0, square = 0, probability = std::pow(1 - share, count);
      for (int k = 0; k <= count; ++k) {
        const double value = stabilised_share(static_cast<float>(k) / count, static_cast<float>(count));
        mean += probability * value;
        square += probability * value * value;
        probability *= (count - k) / (k + 1.0) * share / (1 - share);
      }
      const double expected = 1 / (4 * (count + 0.5));
      EXPECT_NEAR((square - mean * mean) / expected, 1, share * count > 4 ? 0.1 : 0.3) << count << " " << share;
    }
  EXPECT_NEAR(stabilised_share(0.3f, 64) + stabilised_share(0.7f, 64), 3.14159265 / 2, 1e-5);
}

TEST(Statistics, SpectrumOfWhiteNoiseIsFlatAndRowNoiseStandsInItsRidge) {
  const auto density = [](const RawStatistic& raw, int i) { return raw.value[i]; };
  const auto white = of(statistics_of(6, [](int, int row, int col, float z,
                                            const cv::Mat& n) { return z + 0.3f * n.at<float>(row, col); }),
                        "spectrum");
  const auto rows = of(
      statistics_of(6, [](int, int row, int col, float z,
                          const cv::Mat& n) { return z + 0.3f * n.at<float>(row, col) + 0.1f * n.at<float>(row, 0); }),
      "spectrum");
  double ring_5 = 0, ring_8 = 0, ridge = 0, ridge_white = 0;
  for (int s = 0; s < 4; ++s) ring_5 += density(white, 5 * 4 + s), ring_8 += density(white, 8 * 4 + s);
  EXPECT_NEAR(ring_8 / ring_5, (9.0 * 9 - 8 * 8) / (6.0 * 6 - 5 * 5), 0.15);  // ring areas
  for (int k = 40; k < 48; ++k) ridge += rows.value[k], ridge_white += white.value[k];
  EXPECT_GT(ridge, 3 * ridge_white);
}

TEST(Statistics, ShapeOfGaussianNoiseIsGaussianAndTailsShow) {
  const auto gauss = of(statistics_of(6, [](int, int row, int col, float z,
                                            const cv::Mat& n) { return z + 0.3f * n.at<float>(row, col); }),
                        "shape");
  // Standardised by the block's own RMS of n = 64: kurtosis 3 n / (n + 2) = 2.91; 96000 samples: error 0.02.
  EXPECT_NEAR(gauss.value[0], 2.91, 0.08);
  EXPECT_NEAR(gauss.value[1], 0, 0.04);
  EXPECT_EQ(gauss.value[4], 0);
  const auto heavy = of(statistics_of(6,
                                      [](int t, int row, int col, float z, const cv::Mat& n) {
                                        const bool far = (row * 31 + col * 17 + t * 7) % 50 == 0;
                                        return z + (far ? 1.5f : 0.3f) * n.at<float>(row, col);
                                      }),
                        "shape");
  EXPECT_GT(heavy.value[0], 4);
}

TEST(Statistics, TimeSeesFilteringRepeatsAndCourse) {
  const auto white = of(statistics_of(12, [](int, int row, int col, float z,
                                             const cv::Mat& n) { return z + 0.3f * n.at<float>(row, col); }),
                        "time");
  EXPECT_NEAR(white.value[9], 1, 0.03) << "frames of white noise are equally unlike at every lag";
  EXPECT_NEAR(white.value[11], 0, 1e-9);
  const auto drift = of(statistics_of(12, [](int t, int row, int col, float z,
                                             const cv::Mat& n) { return z + 0.1f * t + 0.3f * n.at<float>(row, col); }),
                        "time");
  for (int b = 0; b < 6; ++b) EXPECT_NEAR(drift.value[3 + b], 0.2 * b - 0.5, 0.01);
  const auto repeated = of(
      statistics_of(12, [](int t, int row, int col, float z, const cv::Mat&) { return z + (t / 2) * 0.01f; }), "time");
  EXPECT_NEAR(repeated.value[11], 6.0 / 11, 1e-6);
}

TEST(Statistics, AFrameThatRepeatsWithOtherHolesIsARepeat) {
  // Drop-outs that come after the frame was held: without the repeats known, the noise of a capture of two frames is 0.
  const auto statistics = statistics_of(2, [](int t, int row, int col, float z, const cv::Mat&) {
    const bool hole = (row * 31 + col * 17 + t * 7) % 50 == 0;
    return hole ? 0.f : z + 0.3f * static_cast<float>((row * 7 + col * 13) % 11 - 5);
  });
  EXPECT_EQ(of(statistics, "time").value[11], 1);
  for (const float weight : of(statistics, "noise").weight) EXPECT_EQ(weight, 0);
}

TEST(Statistics, AFrameThatRepeatsSaysNothingNew) {
  // Six frames with noise, and the same with every second one shown twice.
  const auto noisy = [](int, int row, int col, float z, const cv::Mat& n) { return z + 0.3f * n.at<float>(row, col); };
  std::vector<cv::Mat> shown;
  const auto once = statistics_of(6, noisy);
  const auto twice = statistics_of(9, [&](int t, int row, int col, float z, const cv::Mat& n) {
    if (static_cast<int>(shown.size()) <= t) {
      const bool again = t % 3 == 2;
      shown.push_back(again ? shown.back() : n.clone());
    }
    return z + 0.3f * shown[t].at<float>(row, col);
  });
  EXPECT_NEAR(of(twice, "time").value[11], 3.0 / 8, 1e-6);
  const auto before = of(once, "noise"), after = of(twice, "noise");
  double ratio = 0, count = 0;
  for (std::size_t i = 0; i < before.value.size(); ++i)
    if (before.weight[i] > 0 && after.weight[i] > 0) ratio += after.value[i] / before.value[i], count += 1;
  ASSERT_GT(count, 100);
  // Both are variances of 5 pairs of frames in cells of 16 pixels or so: 1 +- 0.2 each, hundreds of them. With the
  // repeats counted it would be 5 / 8.
  EXPECT_NEAR(ratio / count, 1, 0.1);
  // A share of nothing stays what it was, though Anscombe's fractions depend on the number of samples.
  const RawStatistic none = of(once, "drop-out"), still_none = of(twice, "drop-out");
  ASSERT_EQ(none.value, still_none.value);
  const auto& declaration = segment("drop-out");
  for (std::size_t i = 0; i < none.value.size(); ++i) {
    if (none.weight[i] == 0) continue;
    const int at = static_cast<int>(i), n = static_cast<int>(none.value.size());
    EXPECT_NEAR(declaration.stabilise(still_none.value[i], still_none.weight[i], at, n),
                declaration.stabilise(0, 1.5f * none.weight[i], at, n), 1e-5);
  }
}

TEST(Statistics, CombFindsTheDisparityStep) {
  const auto raw = of(statistics_of(2,
                                    [](int, int row, int col, float z, const cv::Mat& n) {
                                      const double d = focal_baseline / (z + 3 * n.at<float>(row, col));
                                      return static_cast<float>(focal_baseline / (std::round(d * 16) / 16));
                                    }),
                      "comb");
  // 16 cycles per px is line 64 of 2..300 in 22 bands.
  const int band = static_cast<int>(std::log(64.0 / 2) / (std::log(301.0 / 2) / 22));
  EXPECT_GT(raw.value[band], 0.9);
  const auto smooth = of(
      statistics_of(2, [](int, int row, int col, float z, const cv::Mat& n) { return z + 3 * n.at<float>(row, col); }),
      "comb");
  EXPECT_LT(smooth.value[band], 0.05);
}

TEST(Statistics, FixedPatternFindsColumnsFinerThanABin) {
  const auto rule = [](float amplitude) {
    return [amplitude](int, int row, int col, float z, const cv::Mat& n) {
      return z + 0.2f * n.at<float>(row, col) + amplitude * std::cos(2 * 3.14159265f * col / 4);
    };
  };
  const auto plain = of(statistics_of(4, rule(0)), "fixed pattern");
  const auto banded = of(statistics_of(4, rule(0.1f)), "fixed pattern");
  // Period 4 px: frequency 1/4, band 12 of 16 between 1/80 and 1/2; half the square of 0.1 mm.
  EXPECT_NEAR(banded.value[12 + 12], 0.005, 0.0005);
  EXPECT_LT(std::abs(plain.value[12 + 12]), 0.0003) << "noise is not fixed: 0.04 mm^2 / 120 rows / 2 frames, twice";
  EXPECT_LT(banded.value[12 + 16 + 12], 0.0005) << "rows carry nothing";
}

TEST(Statistics, TransformIsADifferenceOfStabilisedValues) {
  RawStatistic a, b;
  a.value = {0.2f, 0.4f};
  b.value = {0.1f, 0.4f};
  a.weight = {1, 0};
  b.weight = {1, 1};
  const auto t = segment("noise").transform(a, b);
  EXPECT_NEAR(t[0], std::log(2), 1e-4);
  EXPECT_EQ(t[1], 0) << "unknown";
}

}  // namespace
}  // namespace binrig
