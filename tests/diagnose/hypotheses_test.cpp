#include "diagnose/hypotheses.h"

#include <cmath>
#include <set>

#include <gtest/gtest.h>

#include "core/error.h"
#include "sim/effect.h"

namespace binrig {
namespace {

/// The real catalogue over a recording that meets every need but motion.
class NoMotion : public ForwardModel {
 public:
  const EffectCatalogue& catalogue() const override { return effect_catalogue(); }
  const std::vector<CaptureInfo>& captures() const override { return captures_; }
  const SetInfo& set() const override { return set_; }
  cv::Mat region(int) const override { return {}; }
  std::shared_ptr<const Channels> perfect(int, int, const Offset&, ChannelSet, const SensorModel&) const override {
    throw Error("not asked for here");
  }
  void simulate(const SimulationRequest&, const FrameSink&) const override { throw Error("not asked for here"); }
  std::vector<std::pair<std::string, std::string>> inactive(const SensorModel& model) const override {
    std::vector<std::pair<std::string, std::string>> list;
    for (const auto& effect : model.effects)
      if (effect.declaration(effect_catalogue()).needs.motion) list.emplace_back(effect.id, "nothing moves");
    return list;
  }

 private:
  std::vector<CaptureInfo> captures_;
  SetInfo set_;
};

SensorModel one_effect_model() {
  SensorModel model;
  model.name = "one";
  add_effect(model, effect_catalogue(), "spectral_noise");
  return model;
}

TEST(Hypotheses, EveryAbsentEffectIsOneUnlessTheRecordingCannotShowIt) {
  const NoMotion forward;
  const Hypotheses all = make_hypotheses(forward, one_effect_model());
  std::set<std::string> tested, untested;
  for (const auto& h : all.tested) tested.insert(h.effect);
  for (const auto& u : all.untested) untested.insert(u.effect);
  for (const EffectDeclaration* effect : effect_catalogue().all()) {
    const bool present = effect->name == "spectral_noise";
    if (present || effect->user_defined) {
      EXPECT_FALSE(tested.count(effect->name) || untested.count(effect->name)) << effect->name;
    } else if (effect->needs.motion) {
      EXPECT_TRUE(untested.count(effect->name)) << effect->name;
    } else {
      EXPECT_TRUE(tested.count(effect->name)) << effect->name;
    }
  }
}

TEST(Hypotheses, AtomsLieWithinBoundsAndMakeValidModels) {
  const NoMotion forward;
  for (const auto& hypothesis : make_hypotheses(forward, one_effect_model()).tested) {
    ASSERT_FALSE(hypothesis.paths.empty()) << hypothesis.effect;
    for (const auto& path : hypothesis.paths) {
      ASSERT_FALSE(path.atoms.empty()) << hypothesis.effect;
      for (const auto& atom : path.atoms)
        EXPECT_NO_THROW({
          SensorModel model = with_effect(one_effect_model(), effect_catalogue(), hypothesis.effect, atom.values);
          check_sensor_model(model, effect_catalogue());
        }) << hypothesis.effect;
    }
  }
}

TEST(Hypotheses, WhereTheOtherSignIsNoMirrorImageBothAreSimulated) {
  const NoMotion forward;
  std::set<std::string> both;
  for (const auto& hypothesis : make_hypotheses(forward, one_effect_model()).tested) {
    const EffectDeclaration& effect = *hypothesis.declaration;
    // Pixels that come and go; what changes from frame to frame.
    if (!effect.may_clear && !effect.needs.power_on) continue;
    if (!effect.parameter(effect.amplitude)->either_sign) continue;
    both.insert(effect.name);
    bool plus = false, minus = false;
    for (const auto& path : hypothesis.paths) {
      EXPECT_FALSE(path.mirror) << effect.name;
      (path.atoms.at(0).values.at(effect.amplitude) > 0 ? plus : minus) = true;
    }
    EXPECT_TRUE(plus && minus) << effect.name;
  }
  EXPECT_TRUE(both.contains("focal_error"));
  EXPECT_TRUE(both.contains("thermal_drift"));
}

TEST(Hypotheses, StepsSeenInTheValuesAreTriedByUnit) {
  const NoMotion forward;
  const SeenSteps seen{{{0.731, 1e-3}, {1e6, 1}}, {{0.0417, 1e-5}}};
  int steps = 0;
  for (const auto& h : make_hypotheses(forward, one_effect_model(), seen).tested) {
    std::set<double> tried;
    for (const auto& path : h.paths)
      for (const auto& atom : path.atoms) tried.insert(atom.values.at(h.declaration->amplitude));
    const ParameterSpec& spec = *h.declaration->parameter(h.declaration->amplitude);
    const bool step = is_step(*h.declaration, spec);
    steps += step;
    EXPECT_EQ(tried.contains(0.731), step && spec.unit == "mm") << h.effect;
    EXPECT_EQ(tried.contains(0.0417), step && spec.unit == "px") << h.effect;
    EXPECT_LE(*tried.rbegin(), spec.upper) << h.effect;
  }
  EXPECT_EQ(steps, 2);
}

TEST(Hypotheses, PhasesComeInPairsAQuarterApart) {
  const NoMotion forward;
  int pairs = 0;
  for (const auto& hypothesis : make_hypotheses(forward, one_effect_model()).tested)
    for (const auto& path : hypothesis.paths) {
      if (path.quadrature_of < 0) continue;
      ++pairs;
      const auto& other = hypothesis.paths[path.quadrature_of];
      ASSERT_EQ(path.atoms.size(), other.atoms.size());
      for (const auto& spec : hypothesis.declaration->parameters) {
        const double difference = path.atoms[0].values.at(spec.name) - other.atoms[0].values.at(spec.name);
        EXPECT_NEAR(difference, spec.kind == ParameterKind::phase ? std::acos(0.0) : 0, 1e-12) << hypothesis.effect;
      }
    }
  EXPECT_GT(pairs, 2) << "the catalogue has several periodic effects";
}

// Wherever in the image a spot is, some atom of the hypothesis lies upon it (spots of medium size; image coordinates,
// half the image wide = 1, here of a 4 : 3 image 128 px wide).
TEST(Hypotheses, WhereEachValueIsAnotherTraceTheyLieCloseTogether) {
  const NoMotion forward;
  for (const auto& hypothesis : make_hypotheses(forward, one_effect_model()).tested) {
    if (hypothesis.effect != "noise_bumps") continue;
    const ParameterSpec& frequency = *hypothesis.declaration->parameter("frequency");
    std::set<double> values;
    for (const auto& path : hypothesis.paths)
      if (!path.detail) values.insert(path.atoms[0].values.at("frequency"));
    const double range = frequency.typical_high / frequency.typical_low;
    EXPECT_LE(*values.begin(), frequency.typical_low * std::pow(range, 0.151));
    EXPECT_GE(*values.rbegin(), frequency.typical_low * std::pow(range, 0.849));
    // A ring in the middle between two is off by an eighth: a width of 0.02 at 0.15 per pixel covers that.
    for (auto next = std::next(values.begin()); next != values.end(); ++next) EXPECT_LE(*next / *std::prev(next), 1.28);
  }
}

TEST(Hypotheses, PlacesCoverTheImage) {
  const NoMotion forward;
  for (const auto& h : make_hypotheses(forward, one_effect_model()).tested) {
    if (h.effect != "dust") continue;
    const double medium_px = strength_value(*h.declaration, Strength::medium);
    for (double y = -0.7; y <= 0.7; y += 0.05)
      for (double x = -0.95; x <= 0.95; x += 0.05) {
        double overlap_px = -1e9;
        for (const auto& path : h.paths)
          for (const auto& atom : path.atoms) {
            const double apart_px = 64 * std::hypot(atom.values.at("x") - x, atom.values.at("y") - y);
            overlap_px = std::max(overlap_px, atom.values.at("radius") + medium_px - apart_px);
          }
        EXPECT_GT(overlap_px, 0) << x << ", " << y;
      }
  }
}

// The grid leaves a third of its spacing: as near as that a search by slopes finds a spot of medium size.
TEST(Hypotheses, PlacesCloseByReachTheNextOnesOfTheGrid) {
  const NoMotion forward;
  int places = 0;
  for (const auto& h : make_hypotheses(forward, one_effect_model()).tested) {
    if (!has_place(*h.declaration)) {
      EXPECT_TRUE(by_place(h, h.paths[0].atoms[0].values).paths.empty()) << h.effect;
      continue;
    }
    ++places;
    const auto& from = h.paths.back().atoms[0].values;
    const Hypothesis close = by_place(h, from);
    std::vector<std::string> names;
    for (const auto& spec : h.declaration->parameters)
      if (spec.either_sign && !spec.interpolate) names.push_back(spec.name);
    ASSERT_EQ(names.size(), 2u) << h.effect;
    for (double dx = -0.3; dx <= 0.3; dx += 0.05)
      for (double dy = -0.25; dy <= 0.25; dy += 0.05) {
        double nearest = 1e9;
        for (const auto& path : close.paths) {
          ASSERT_EQ(path.atoms.size(), 3u);
          nearest = std::min(nearest, std::hypot(path.atoms[0].values.at(names[0]) - from.at(names[0]) - dx,
                                                 path.atoms[0].values.at(names[1]) - from.at(names[1]) - dy));
        }
        EXPECT_LT(nearest, 0.08) << h.effect << " " << dx << ", " << dy;
      }
  }
  EXPECT_GT(places, 0);
}

TEST(Hypotheses, AToneIsNoWaveNoPlaceAndNoStep) {
  for (const char* wave : {"tof_wiggling", "column_banding", "pixel_locking"})
    EXPECT_FALSE(has_tone(find_effect(wave)->declaration)) << wave;
  for (const char* place : {"dust", "ambient_noise"}) EXPECT_FALSE(has_tone(find_effect(place)->declaration)) << place;
  for (const char* step : {"depth_units", "disparity_quantisation"})
    EXPECT_FALSE(has_tone(find_effect(step)->declaration)) << step;
  EXPECT_TRUE(has_tone(find_effect("noise_bumps")->declaration));
}

}  // namespace
}  // namespace binrig
