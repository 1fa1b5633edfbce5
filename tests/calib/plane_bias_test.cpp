#include "calib/plane_bias.h"

#include <cmath>

#include <gtest/gtest.h>

#include "core/random.h"

namespace binrig {
namespace {

std::vector<PlaneBias> captures(const std::vector<double>& distances, double offset, double scale, std::uint64_t seed) {
  std::vector<PlaneBias> result;
  for (std::size_t i = 0; i < distances.size(); ++i)
    result.push_back({"train/" + std::to_string(i + 1), distances[i],
                      offset + scale * distances[i] + 0.15 * RandomStream(seed).normal(i), 0.15});
  return result;
}

const BiasTerm offset_term{"depth_offset", "offset", BiasTerm::Law::offset, 0, 5};
const BiasTerm scale_term{"depth_scale", "scale", BiasTerm::Law::scale, 0, 0.01};

TEST(PlaneBias, IntervalsCoverTheTruth) {
  // 95 % of 200 runs: 190 +- 3.1, three standard deviations below and what widening adds above.
  int offset_in = 0, scale_in = 0;
  for (int seed = 0; seed < 200; ++seed) {
    const auto values =
        fit_biases(captures({500, 600, 700, 800, 900, 1000}, 1.2, 0.002, seed), {offset_term, scale_term});
    offset_in += values[0].ci95[0] <= 1.2 && 1.2 <= values[0].ci95[1];
    scale_in += values[1].ci95[0] <= 0.002 && 0.002 <= values[1].ci95[1];
  }
  EXPECT_GE(offset_in, 181);
  EXPECT_GE(scale_in, 181);
}

TEST(PlaneBias, OneTermAloneIsDeterminedAtOneDistance) {
  const auto values = fit_biases(captures({800, 800, 800}, 1.0, 0, 3), {offset_term});
  EXPECT_TRUE(values[0].determined);
  EXPECT_NEAR(values[0].value, 1, 0.4);
}

TEST(PlaneBias, SaysWhatTheCapturesCannotDetermine) {
  const auto same = fit_biases(captures({800, 800, 800}, 1.0, 0, 3), {offset_term, scale_term});
  EXPECT_FALSE(same[0].determined);
  EXPECT_NE(same[0].reason.find("one distance"), std::string::npos) << same[0].reason;
  const auto near = fit_biases(captures({795, 800, 805, 810}, 0.1, 0, 3), {offset_term, scale_term});
  EXPECT_FALSE(near[1].determined);
  EXPECT_FALSE(near[1].reason.empty());
  EXPECT_FALSE(fit_biases({}, {offset_term})[0].determined);
  EXPECT_FALSE(fit_biases(captures({800}, 1, 0, 1), {offset_term, scale_term})[0].determined);
  EXPECT_TRUE(fit_biases(captures({800}, 1, 0, 1), {}).empty());
}

}  // namespace
}  // namespace binrig
