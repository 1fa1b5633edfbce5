// The verdict on captures whose difference is known.
#include "compare/fidelity.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "compare/fidelity_report.h"
#include "core/error.h"
#include "tests/compare/plane_captures.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

using test::made_capture;
using test::MadePlane;
using testing::HasSubstr;

Fidelity compared(const MadePlane& measured, const MadePlane& simulated) {
  std::vector<CaptureFidelity> captures;
  captures.push_back(
      compare_profiles(noise_profile(made_capture(measured)), noise_profile(made_capture(simulated)), "test/1", true));
  return judge(std::move(captures));
}

const Aspect& aspect(const Fidelity& f, const std::string& id) {
  for (const Aspect& a : f.overall) {
    if (a.id == id) return a;
  }
  throw Error("no aspect " + id);
}

TEST(Fidelity, EqualSensorsAgree) {
  MadePlane a, b;
  a.storage_mm = b.storage_mm = 0.1;
  b.seed = 2;
  const Fidelity f = compared(a, b);
  for (const Aspect& x : f.overall) EXPECT_NE(x.agreement, Agreement::differs) << x.id << " p " << x.p_value;
  EXPECT_EQ(aspect(f, "noise_level").agreement, Agreement::agrees);
  EXPECT_EQ(aspect(f, "spectrum").agreement, Agreement::agrees);
  EXPECT_EQ(aspect(f, "correlation_length").agreement, Agreement::agrees);
}

TEST(Fidelity, EachDifferenceIsNamed) {
  MadePlane real;
  real.seed = 7;
  const auto differs = [&](const MadePlane& other, const std::string& id) {
    const Fidelity f = compared(real, other);
    EXPECT_EQ(aspect(f, id).agreement, Agreement::differs)
        << id << " effect " << aspect(f, id).effect << " p " << aspect(f, id).p_value;
    EXPECT_EQ(f.verdict, Agreement::differs);
    EXPECT_FALSE(f.reasons.empty());
  };
  MadePlane louder;
  louder.sigma_mm = 0.4;
  differs(louder, "noise_level");
  MadePlane strawman;
  strawman.correlation_px = 0;
  strawman.white_share = 1;
  differs(strawman, "spectrum");
  differs(strawman, "correlation_length");
  MadePlane rows;
  rows.row_mm = 0.2;
  differs(rows, "row_noise");
  MadePlane holes;
  holes.holes = 0.1;
  differs(holes, "fill_rate");
  MadePlane pattern;
  pattern.pattern_mm = 0.4;
  differs(pattern, "fixed_pattern");
  MadePlane lasting;
  lasting.memory = 0.6;
  lasting.frames = 12;
  differs(lasting, "frame_correlation");
}

TEST(Fidelity, ADifferenceWithinTheToleranceAgreesHoweverCertain) {
  MadePlane real, close;
  close.sigma_mm = 0.315;
  close.seed = 3;
  real.frames = close.frames = 20;
  const Fidelity f = compared(real, close);
  EXPECT_EQ(aspect(f, "noise_level").agreement, Agreement::agrees);
  EXPECT_NEAR(aspect(f, "noise_level").effect, 0.05, 0.02);
}

TEST(Fidelity, LimitsAreCheckedAndUnknownOnesRefused) {
  MadePlane louder;
  louder.sigma_mm = 0.4;
  const Fidelity f = compared({}, louder);
  EXPECT_TRUE(broken_limits(f, {{"noise_level", 0.5}}).empty());
  const auto broken = broken_limits(f, {{"noise_level", 0.1}, {"correlation_length", 0.5}});
  ASSERT_EQ(broken.size(), 1u);
  EXPECT_THAT(broken[0], HasSubstr("noise_level"));
  try {
    broken_limits(f, {{"noise_leve", 0.1}});
    FAIL();
  } catch (const Error& e) {
    EXPECT_THAT(e.what(), HasSubstr("noise_level"));
  }
}

TEST(Fidelity, TheReportHoldsPicturesTablesAndJson) {
  const test::ScratchFolder folder;
  MadePlane real, other;
  real.holes = 0.05;
  other.sigma_mm = 0.4;
  other.seed = 4;
  const Fidelity f = compared(real, other);
  Page page("Fidelity", "made frames");
  draw_verdict(page, f);
  draw_fidelity(page, f);
  page.write(folder.path());
  for (const char* name : {"depth", "residual", "cloud", "histogram", "spectrum", "autocorrelation", "spectrum_2d",
                           "bias", "sigma", "fill"}) {
    EXPECT_TRUE(std::filesystem::exists(folder / (std::string("test_1_") + name + ".png"))) << name;
  }
  const auto json = fidelity_json(f);
  EXPECT_EQ(json["verdict"], "differs");
  EXPECT_EQ(json["captures"][0]["measured"]["white"]["rejected"], true);
  EXPECT_EQ(nlohmann::json::parse(json.dump()), json);
}

}  // namespace
}  // namespace binrig
