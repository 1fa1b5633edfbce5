#include "compare/masks.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "compare/scene_report.h"
#include "core/error.h"
#include "core/random.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

constexpr auto shadow = static_cast<std::uint8_t>(Reason::shadow);
constexpr auto grazing = static_cast<std::uint8_t>(Reason::low_confidence);
constexpr auto unknown = static_cast<std::uint8_t>(Reason::unknown);

cv::Mat with(const cv::Rect& where, std::uint8_t value, cv::Mat image = cv::Mat(240, 320, CV_8U, cv::Scalar(0))) {
  image = image.clone();
  image(where).setTo(value);
  return image;
}

const cv::Mat everywhere(240, 320, CV_8U, cv::Scalar(255));

TEST(Masks, SharesAreThoseOfTheSets) {
  // Missing: 100 columns x 40 rows. Shadow covers half of it and as much beside it; grazing a quarter of it alone.
  const cv::Mat measured = with({100, 100, 100, 40}, unknown);
  const cv::Mat predicted = with({50, 100, 100, 40}, shadow, with({150, 100, 25, 40}, grazing));
  MaskTally tally;
  tally.add(measured, predicted, everywhere);
  const MaskScore s = mask_score("m", {&tally}, 1);
  EXPECT_DOUBLE_EQ(s.missing_share, 4000.0 / 76800);
  EXPECT_DOUBLE_EQ(s.predicted_share, 5000.0 / 76800);
  EXPECT_DOUBLE_EQ(s.precision.value, 0.6);
  EXPECT_DOUBLE_EQ(s.recall.value, 0.75);
  EXPECT_DOUBLE_EQ(s.iou.value, 3000.0 / 6000);
  EXPECT_DOUBLE_EQ(s.unexplained.value, 0.25);
  ASSERT_EQ(s.by_reason.size(), 2u);
  EXPECT_EQ(s.by_reason[0].reason, Reason::shadow);
  EXPECT_DOUBLE_EQ(s.by_reason[0].precision.value, 0.5);
  EXPECT_DOUBLE_EQ(s.by_reason[0].recall.value, 0.5);
  EXPECT_DOUBLE_EQ(s.by_reason[0].iou.value, 2000.0 / 6000);
  EXPECT_DOUBLE_EQ(s.by_reason[1].precision.value, 1);
  for (const ShareInterval& i : {s.precision, s.recall, s.iou, s.unexplained}) {
    EXPECT_LE(i.low, i.value);
    EXPECT_GE(i.high, i.value);
  }
}

TEST(Masks, UncountedPixelsCountNowhere) {
  cv::Mat counted = everywhere.clone();
  counted.colRange(0, 160).setTo(0);
  MaskTally tally;
  tally.add(with({0, 0, 320, 240}, unknown), with({0, 0, 160, 240}, shadow), counted);
  const MaskScore s = mask_score("m", {&tally}, 1);
  EXPECT_DOUBLE_EQ(s.pixels, 160 * 240);
  EXPECT_DOUBLE_EQ(s.missing_share, 1);
  EXPECT_DOUBLE_EQ(s.predicted_share, 0);
  EXPECT_TRUE(s.by_reason.empty());
}

TEST(Masks, PerfectPredictionIsPerfectAndNothingMissingIsNoDivisionByZero) {
  MaskTally tally;
  tally.add(with({100, 100, 60, 40}, unknown), with({100, 100, 60, 40}, shadow), everywhere);
  const MaskScore s = mask_score("m", {&tally}, 1);
  EXPECT_DOUBLE_EQ(s.iou.value, 1);
  MaskTally nothing;
  nothing.add(cv::Mat(240, 320, CV_8U, cv::Scalar(0)), cv::Mat(240, 320, CV_8U, cv::Scalar(0)), everywhere);
  EXPECT_DOUBLE_EQ(mask_score("m", {&nothing}, 1).iou.value, 0);
}

// Intervals must hold the truth about as often as they say, when missing pixels come in patches: 100 recordings of
// patches of 16 x 16 px, each predicted with probability 0.7. A coverage of 95 % from 100 runs has a standard error of
// 2.2 %; the percentile bootstrap of 35 blocks is known to fall short by a few per cent.
TEST(Masks, IntervalsRespectPatches) {
  int held = 0;
  for (int run = 0; run < 100; ++run) {
    const RandomStream stream(run);
    cv::Mat measured(240, 320, CV_8U, cv::Scalar(0)), predicted = measured.clone();
    for (int i = 0; i < 20 * 15; ++i) {
      if (stream.uniform(2 * i) > 0.3) continue;
      const cv::Rect patch(16 * (i % 20), 16 * (i / 20), 16, 16);
      measured(patch).setTo(unknown);
      if (stream.uniform(2 * i + 1) < 0.7) predicted(patch).setTo(shadow);
    }
    MaskTally tally;
    tally.add(measured, predicted, everywhere);
    const auto recall = mask_score("m", {&tally}, 5).recall;
    held += recall.low <= 0.7 && 0.7 <= recall.high;
  }
  EXPECT_GE(held, 84);
}

TEST(Masks, SizesMustFit) {
  MaskTally tally;
  EXPECT_THROW(tally.add(everywhere, cv::Mat(10, 10, CV_8U), everywhere), Error);
}

TEST(Scenes, DepartureMasksAndReport) {
  Channels perfect;
  perfect.depth_mm = cv::Mat(240, 320, CV_32F, cv::Scalar(800));
  perfect.depth_mm.colRange(0, 20).setTo(0);
  perfect.edge_px = cv::Mat(240, 320, CV_32F, cv::Scalar(64));
  SceneComparison comparison("test/1", {"perfect depth", "all effects"}, {});
  for (int t = 0; t < 4; ++t) {
    const auto make = [&](double offset, double sigma, const cv::Rect& hole, std::uint64_t seed) {
      Frame f;
      f.depth_mm.create(240, 320, CV_32F);
      RandomStream(seed * 100 + t).fill_normal(f.depth_mm);
      f.depth_mm = cv::Mat(f.depth_mm * sigma + 800 + offset);
      f.reason = cv::Mat(240, 320, CV_8U, cv::Scalar(0));
      f.depth_mm(hole).setTo(0);
      f.reason(hole).setTo(seed == 1 ? unknown : shadow);
      return f;
    };
    const Frame measured = make(1.5, 0.5, {100, 100, 40, 40}, 1);
    comparison.add_measured(measured, perfect);
    comparison.add_simulated(0, make(0, 1e-3, {}, 2), measured, perfect);
    comparison.add_simulated(1, make(0, 0.3, {110, 100, 40, 40}, 3), measured, perfect);
  }
  const SceneFidelity scene = comparison.finish(1);
  EXPECT_EQ(scene.frames, 4);
  EXPECT_NEAR(scene.measured.median_mm, 1.5, 0.02);  // median of 60,000 draws of sigma 0.5: standard error 0.0026
  EXPECT_NEAR(scene.measured.spread_mm, 0.5, 0.02);
  EXPECT_NEAR(scene.simulated.spread_mm, 0.3, 0.02);
  // The median of the root of a chi-square of 3 over 3: 0.888 sigma.
  EXPECT_NEAR(scene.measured.temporal_sigma_mm, 0.888 * 0.5, 0.01);
  EXPECT_DOUBLE_EQ(scene.scores[0].recall.value, 0);
  EXPECT_DOUBLE_EQ(scene.scores[1].recall.value, 0.75);
  const test::ScratchFolder folder;
  Page page("Scenes", "made");
  const auto pools = pool_scenes({scene}, 1);
  ASSERT_EQ(pools.size(), 1u);
  draw_scenes(page, {scene}, pools);
  page.write(folder.path());
  EXPECT_TRUE(std::filesystem::exists(folder / "test_1_reasons.png"));
  EXPECT_TRUE(std::filesystem::exists(folder / "test_1_bias.png"));
}

}  // namespace
}  // namespace binrig
