// Maps and curves of what a model leaves, before and after.
#include "diagnose/where.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

/// How many points of a curve lie outside the band, and how many there are.
struct Outside {
  int of = 0, before = 0, after = 0;
};
Outside outside(const Course& course) {
  Outside count;
  for (std::size_t i = 0; i < course.at.size(); ++i) {
    EXPECT_LE(course.low[i], course.even);
    EXPECT_GE(course.high[i], course.even);
    const auto beyond = [&](double value) { return value < course.low[i] || value > course.high[i]; };
    ++count.of;
    count.before += beyond(course.before[i]);
    count.after += beyond(course.after[i]);
  }
  return count;
}

TEST(Where, CurvesLeaveTheBandWhereAnEffectIsMissingAndComeBackWithIt) {
  const Case c(model_with("radial_distortion", {{"amplitude", 0.8}}), noise_alone(0.3));
  const RungOptions options{.simulations = 24};
  const Rung lacking = c.fitted(options), right = fit_rung(c.experiment, c.motions, c.measured, c.truth, {}, options);
  const Where where(c.experiment, c.motions, c.measured.all, lacking, right);

  int of = 0, after = 0;
  bool seen = false;
  std::set<std::string> segments_shown;
  for (const Course& course : where.courses()) {
    const Outside count = outside(course);
    of += count.of, after += count.after;
    segments_shown.insert(course.segment);
    EXPECT_TRUE(std::is_sorted(course.at.begin(), course.at.end())) << course.segment << " " << course.covariate;
    if (course.segment == "bias") seen |= 2 * count.before > count.of;
  }
  EXPECT_TRUE(seen) << "half of a curve of the bias lies outside";
  // 95 % lie inside; neighbours go together, so that four times the expected 5 % is no surprise.
  EXPECT_LE(after, of / 5) << of;
  EXPECT_TRUE(segments_shown.count("bias") && segments_shown.count("noise") && segments_shown.count("spectrum"));

  double before_square = 0, after_square = 0;
  int bias_maps = 0;
  for (const Maps& maps : where.maps()) {
    EXPECT_GT(cv::countNonZero(maps.valid), 0);
    if (maps.segment != "bias") continue;
    ++bias_maps;
    before_square += cv::norm(maps.before, cv::NORM_L2SQR, maps.valid);
    after_square += cv::norm(maps.after, cv::NORM_L2SQR, maps.valid);
  }
  EXPECT_EQ(bias_maps, 6);
  EXPECT_LT(after_square, before_square / 2);
}

TEST(Where, ATargetThatStandsElsewhereIsNoBias) {
  const Case c(noise_alone(0.3), noise_alone(0.3));
  const RungOptions options{.simulations = 16, .passes = 0};
  std::vector<Offset> astray(c.experiment.layout().captures);
  for (Offset& offset : astray) offset.pose[5] = 1;  // mm
  const Rung rung = fit_rung(c.experiment, c.motions, c.measured, c.start, astray, options);
  for (const Maps& maps : Where(c.experiment, c.motions, c.measured.all, rung, rung).maps())
    if (maps.segment == "bias") {
      EXPECT_LT(std::abs(cv::mean(maps.after, maps.valid)[0]), 0.1) << maps.capture;
    }
}

}  // namespace
}  // namespace binrig
