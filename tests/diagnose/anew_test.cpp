// The second look from the parameters as they were given, and the signatures that it is taken with, on recordings whose
// truth is known.
#include "diagnose/anew.h"

#include <algorithm>
#include <numeric>
#include <set>

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

Hypotheses hypotheses_of(const Case& c, const SensorModel& given, const std::set<std::string>& effects) {
  Hypotheses hypotheses = make_hypotheses(c.experiment.forward(), given);
  std::erase_if(hypotheses.tested, [&](const Hypothesis& h) { return !effects.contains(h.effect); });
  return hypotheses;
}

/// All of the hypotheses with their first signatures about `given`.
struct Asked {
  Hypotheses hypotheses;
  SignatureBook book;

  Asked(const Case& c, const SensorModel& given, const std::set<std::string>& effects)
      : hypotheses(hypotheses_of(c, given, effects)), book(c.experiment, given, hypotheses, {}) {
    std::vector<int> all(hypotheses.tested.size());
    std::iota(all.begin(), all.end(), 0);
    book.look_at(all, false);
  }
};

TEST(LookAnew, FindsAPeriodThatNoSignatureHas) {
  // Signatures know wavelengths of 50, 300 and 3000 mm or so; the wave at 130 mm is none of them.
  const SensorModel given = model_with("depth_offset", {{"offset", 0}});
  SensorModel truth = given;
  add_effect(truth, effect_catalogue(), "tof_wiggling", {{"amplitude", 0.55}, {"wavelength", 130}, {"phase", 1}});
  const Case c(truth, given);
  const Asked asked(c, given, {"tof_wiggling", "depth_scale", "disparity_offset"});
  const auto& [hypotheses, book] = asked;
  ASSERT_EQ(hypotheses.tested.size(), 3);
  const auto looks = [&](int known) {
    return look_anew(c.experiment, c.motions, c.measured, {given, book.signatures(), book.simulations()}, hypotheses,
                     known, 1, 11);
  };
  const auto found = looks(-1);
  ASSERT_EQ(found.size(), 1);
  ASSERT_EQ(hypotheses.tested[found[0].hypothesis].effect, "tof_wiggling");
  const EffectInstance& wave = *found[0].fit.model.find(found[0].id);
  // Half a wave more or less between 650 and 950 mm is another wavelength by 130 / (2 * 300 / 130) / 2 = 14 mm.
  EXPECT_NEAR(wave.value("wavelength"), 130, 14);
  EXPECT_NEAR(wave.value("amplitude"), 0.55, 0.15);
  EXPECT_TRUE(looks(found[0].hypothesis).empty());  // who knows it already need not look
}

TEST(LookAnew, SeesAFocalErrorBesideWhatWasAdded) {
  // A fitted focal length takes a focal error over; from the stated one, with the banding that was found first, it
  // shows.
  const SensorModel given = model_with("depth_offset", {{"offset", 0}});
  SensorModel with_banding = given;
  add_effect(with_banding, effect_catalogue(), "row_banding", {{"amplitude", 0.5}, {"period", 21}, {"phase", 1}});
  SensorModel truth = with_banding;
  add_effect(truth, effect_catalogue(), "focal_error", {{"error", 0.02}});
  const Case c(truth, with_banding);
  const Asked asked(c, given, {"focal_error", "depth_scale", "disparity_offset"});
  const auto& [hypotheses, book] = asked;
  ASSERT_EQ(hypotheses.tested.size(), 3);
  const Beginning from{with_banding, book.signatures(), book.simulations_of(with_banding)};
  const auto found = look_anew(c.experiment, c.motions, c.measured, from, hypotheses, -1, 1, 11);
  ASSERT_EQ(found.size(), 1);
  ASSERT_EQ(hypotheses.tested[found[0].hypothesis].effect, "focal_error");
  // The focal length is stated to 0.25 px of about 110 px.
  EXPECT_NEAR(found[0].fit.model.find(found[0].id)->value("error"), 0.02, 3 * 0.25 / 110);
}

TEST(LookAnew, FitsOnlyWhatExplainsEnoughBeforeItIsFitted) {
  // Signatures stand at 0.5 and 1.2 px or so: a quarter of a pixel is nearer to none than to the weaker of them.
  const SensorModel given = model_with("depth_offset", {{"offset", 0}});
  SensorModel truth = given;
  add_effect(truth, effect_catalogue(), "radial_distortion", {{"amplitude", 0.25}});
  const Case c(truth, given);
  const Asked asked(c, given, {"radial_distortion", "lateral_noise", "heavy_tails"});
  const auto& [hypotheses, book] = asked;
  ASSERT_EQ(hypotheses.tested.size(), 3);
  std::vector<double> least_share(3, 0.01);  // noise that is not there explains nothing, of whatever is left
  const auto looks = [&] {
    return look_anew(c.experiment, c.motions, c.measured, {given, book.signatures(), book.simulations()}, hypotheses,
                     -1, 3, 11, least_share);
  };
  const auto found = looks();
  ASSERT_EQ(found.size(), 1);
  ASSERT_EQ(hypotheses.tested[found[0].hypothesis].effect, "radial_distortion");
  EXPECT_NEAR(found[0].fit.model.find(found[0].id)->value("amplitude"), 0.25, 0.1);
  least_share[found[0].hypothesis] = 1;  // that is all
  EXPECT_TRUE(looks().empty());
}

TEST(SignatureBook, KeepsInTheMeanWhatOtherPixelsTossForInEachSimulation) {
  const SensorModel given = model_with("depth_offset", {{"offset", 0}});
  const Case c(given, given);
  const Asked asked(c, given, {"random_dropout"});
  const auto& [hypotheses, book] = asked;
  ASSERT_EQ(hypotheses.tested.size(), 1);
  ASSERT_FALSE(book.signatures().empty());
  const Layout& layout = c.experiment.layout();
  for (const Signature& signature : book.signatures())
    for (int capture = 0; capture < layout.captures; ++capture) {
      if (!layout.train[capture]) continue;
      const Block& block = *layout.find(capture, "drop-out");
      const float* first = signature.change->data() + block.offset;
      EXPECT_GT(*std::max_element(first, first + block.size), 0.f) << "atom " << signature.atom;
    }
}

}  // namespace
}  // namespace binrig
