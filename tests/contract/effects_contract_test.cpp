// What holds for every effect of the program, by itself: a new file in sim/effects is under these tests at once.
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <numbers>

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "sim/sensor.h"
#include "tests/support/effect_run.h"

namespace binrig {
namespace {

constexpr int frames = 3;

/// A capture that meets every need: projector and IR known, begins with power-on, moves, has several frames.
struct Capture {
  test::AnalyticScene scene = test::mixed_scene();
  CaptureContext context;
  std::vector<std::shared_ptr<const Channels>> channels;

  Capture() {
    scene.velocity_mm_per_s = Vector3(40, 10, 30);
    scene.box->second.x() = -90;  // room for a piece of sky below
    context = test::analytic_context(scene, test::small_camera().resized(96, 72));
    context.frames = frames;
    // Views are made once: the tests apply every effect some thousand times.
    context.render = [render = context.render,
                      made = std::make_shared<std::map<std::string, std::shared_ptr<const Channels>>>()](
                         const View& view, int frame) {
      const std::string key = number_text(view.camera.fx) + " " + number_text(view.time_s.value_or(0.1 * frame)) + " " +
                              (view.projector_xyz_mm ? number_text(view.projector_xyz_mm->x()) : "own");
      auto& channels = (*made)[key];
      if (!channels) channels = render(view, frame);
      return channels;
    };
    for (int i = 0; i < frames; ++i) {
      channels.push_back(test::analytic_channels(scene, context.camera, context.projector_xyz_mm,
                                                 context.reference_distance_mm, 0.1 * i));
    }
  }
};

const Capture& capture() {
  static const Capture shared;
  return shared;
}

/// The effect with its amplitude at `strength`; user-defined ones through a model file, as a user writes them.
EffectInstance instance_of(const Effect& effect, Strength strength = Strength::strong) {
  if (effect.declaration.user_defined) {
    const std::string text =
        "effects:\n  - " + effect.declaration.name +
        ": {stage: geometry, on: depth, expression: \"a*x + 0*n\", parameters: {a: {value: 0.7, unit: mm, "
        "bounds: [-2, 2], neutral: 0}}}\n";
    return parse_sensor_model(text, "contract.yaml", effect_catalogue()).effects.at(0);
  }
  EffectInstance instance = test::make_instance(effect.declaration.name);
  instance.values.at(effect.declaration.amplitude).value = strength_value(effect.declaration, strength);
  return instance;
}

const EffectDeclaration& declaration_of(const EffectInstance& instance) {
  return instance.declaration(effect_catalogue());
}

SensorModel model_of(const std::vector<EffectInstance>& instances) {
  SensorModel model;
  model.name = "contract";
  model.effects = instances;
  std::stable_sort(model.effects.begin(), model.effects.end(), [](const EffectInstance& a, const EffectInstance& b) {
    return declaration_of(a).stage < declaration_of(b).stage;
  });
  check_sensor_model(model, effect_catalogue());
  return model;
}

std::vector<Frame> simulate(const SensorModel& model, const CaptureContext& context = capture().context) {
  SensorRun run(model, context);
  EXPECT_TRUE(run.inactive().empty()) << run.inactive().front().first << ": " << run.inactive().front().second;
  std::vector<Frame> result;
  for (int i = 0; i < frames; ++i) {
    FrameInstant instant{i, 0.1 * i, 0.1 * i};
    result.push_back(run.frame(*capture().channels[i], instant));
    result.back().check("frame " + std::to_string(i));
  }
  return result;
}

bool same_bytes(const cv::Mat& a, const cv::Mat& b) {
  if (a.size() != b.size() || a.type() != b.type()) return false;
  for (int row = 0; row < a.rows; ++row) {
    if (std::memcmp(a.ptr(row), b.ptr(row), a.cols * a.elemSize()) != 0) return false;
  }
  return true;
}

bool same(const Layers& a, const Layers& b) {
  return same_bytes(a.depth_mm, b.depth_mm) && same_bytes(a.sigma_scale, b.sigma_scale) &&
         same_bytes(a.noise_mm, b.noise_mm) && same_bytes(a.reason, b.reason);
}

bool same(const std::vector<Frame>& a, const std::vector<Frame>& b) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!same_bytes(a[i].depth_mm, b[i].depth_mm) || !same_bytes(a[i].reason, b[i].reason)) return false;
  }
  return true;
}

/// Layers of a frame as an effect in the middle of the list finds them: noise present and a tenth of the pixels
/// invalid, whose depth is `invalid_depth`.
Layers busy_layers(int frame, float invalid_depth) {
  Layers layers = test::fresh_layers(*capture().channels[frame]);
  const RandomStream stream(77);
  cv::Mat noise(layers.depth_mm.size(), CV_32F), holes(layers.depth_mm.size(), CV_32F);
  stream.child(frame).fill_normal(noise);
  stream.child("holes").fill_uniform(holes);
  layers.noise_mm = 0.2f * noise;
  layers.depth_mm += 0.5f * noise;
  layers.reason.setTo(static_cast<int>(Reason::unknown), (holes < 0.1f) & (layers.reason == 0));
  layers.depth_mm.setTo(invalid_depth, layers.reason != 0);
  return layers;
}

std::vector<Layers> apply_all(const EffectInstance& instance, std::vector<Layers> layers,
                              const CaptureContext& context = capture().context) {
  test::EffectUnderTest run(instance, context);
  for (int i = 0; i < static_cast<int>(layers.size()); ++i) run.apply(layers[i], *capture().channels[i], i);
  return layers;
}

std::vector<Layers> busy(float invalid_depth = 0) {
  std::vector<Layers> layers;
  for (int i = 0; i < frames; ++i) layers.push_back(busy_layers(i, invalid_depth));
  return layers;
}

class EveryEffect : public testing::TestWithParam<const Effect*> {
 protected:
  const Effect& effect() const { return *GetParam(); }
  const EffectDeclaration& declaration() const { return GetParam()->declaration; }
};

TEST_P(EveryEffect, DeclarationIsComplete) {
  const EffectDeclaration& what = declaration();
  EXPECT_FALSE(what.phenomenon.empty());
  EXPECT_FALSE(what.formula.empty());
  EXPECT_FALSE(what.citation.empty());
  EXPECT_FALSE(what.revealed_by.empty());
  if (what.user_defined) return;
  const ParameterSpec* amplitude = what.parameter(what.amplitude);
  ASSERT_NE(amplitude, nullptr) << what.amplitude;
  EXPECT_TRUE(amplitude->neutral.has_value());
  EXPECT_GT(amplitude->typical_low, 0) << "strengths are points on a log scale";
  for (const ParameterSpec& p : what.parameters) {
    SCOPED_TRACE(p.name);
    EXPECT_FALSE(p.unit.empty());
    EXPECT_FALSE(p.meaning.empty());
    EXPECT_LT(p.lower, p.upper);
    EXPECT_LE(p.typical_low, p.typical_high);
    EXPECT_GE(p.typical_low, p.lower);
    EXPECT_LE(p.typical_high, p.upper);
    if (p.either_sign) {
      EXPECT_LE(p.lower, -p.typical_high);
    }
    EXPECT_GE(p.initial, p.lower);
    EXPECT_LE(p.initial, p.upper);
    if (p.log_scaled) {
      EXPECT_GT(p.initial, 0);
    }
    if (p.neutral) {
      EXPECT_GE(*p.neutral, p.lower);
      EXPECT_LE(*p.neutral, p.upper);
    }
    if (p.kind == ParameterKind::phase) {
      EXPECT_EQ(p.unit, "rad");
      EXPECT_GE(p.upper - p.lower, 2 * std::numbers::pi - 1e-9);
    }
  }
  const bool masks = what.stage == Stage::signal_mask || what.stage == Stage::device;
  EXPECT_EQ(masks, what.reason.has_value());
}

TEST_P(EveryEffect, StrongOneCanBeSeen) {
  // On top of some noise and holes: there are effects that act on these alone.
  EffectInstance noise = test::make_instance("spectral_noise");
  noise.id = "base_noise";
  noise.values.at("sigma").value = 0.3;
  EffectInstance holes = test::make_instance("low_confidence");
  holes.id = "base_holes";
  EXPECT_FALSE(same(simulate(model_of({noise, holes, instance_of(effect())})), simulate(model_of({noise, holes}))));
}

TEST_P(EveryEffect, NeutralChangesNothing) {
  EffectInstance instance = instance_of(effect());
  bool any = false;
  for (const ParameterSpec& p : declaration_of(instance).parameters) {
    if (!p.neutral) continue;
    instance.values.at(p.name).value = *p.neutral;
    any = true;
  }
  ASSERT_TRUE(any);
  EXPECT_TRUE(effect().is_neutral(instance));
  // Not only skipped: the effect itself does nothing there (3e-4 mm: float rounding of z -> d -> z at 900 mm).
  const std::vector<Layers> before = busy(), after = apply_all(instance, busy());
  for (int i = 0; i < frames; ++i) {
    EXPECT_TRUE(same_bytes(before[i].reason, after[i].reason));
    const cv::Mat valid = before[i].reason == 0;
    EXPECT_LE(cv::norm(before[i].depth_mm, after[i].depth_mm, cv::NORM_INF, valid), 3e-4);
    EXPECT_LE(cv::norm(before[i].noise_mm, after[i].noise_mm, cv::NORM_INF, valid), 3e-4);
    EXPECT_LE(cv::norm(before[i].sigma_scale, after[i].sigma_scale, cv::NORM_INF, valid), 1e-5);
  }
}

TEST_P(EveryEffect, BoundsHold) {
  const EffectInstance initial = instance_of(effect());
  for (const ParameterSpec& p : declaration_of(initial).parameters) {
    for (const double value : {p.lower, p.upper}) {
      SCOPED_TRACE(p.name + " = " + number_text(value));
      EffectInstance instance = initial;
      instance.values.at(p.name).value = value;
      simulate(model_of({instance}));  // checks every frame: no NaN, no depth without its reason
    }
    for (const double value : {p.lower - 1 - std::abs(p.lower), p.upper + 1 + std::abs(p.upper), std::nan("")}) {
      EffectInstance instance = initial;
      instance.values.at(p.name).value = value;
      try {
        model_of({instance});
        ADD_FAILURE() << p.name << " = " << value << " was accepted";
      } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find(p.name), std::string::npos) << error.what();
      }
    }
  }
}

TEST_P(EveryEffect, SameSeedSameBytesOnAnyNumberOfThreads) {
  const EffectInstance instance = instance_of(effect());
  const std::vector<Frame> reference = simulate(model_of({instance}));
  EXPECT_TRUE(same(simulate(model_of({instance})), reference));
  set_jobs(1);
  const std::vector<Frame> single = simulate(model_of({instance}));
  set_jobs(0);
  EXPECT_TRUE(same(single, reference));
}

TEST_P(EveryEffect, OtherEffectsAtWorkChangeNoDraw) {
  const EffectInstance instance = instance_of(effect());
  const std::vector<Layers> alone = apply_all(instance, busy());
  test::EffectUnderTest run(instance, capture().context);
  std::vector<Layers> among_others = busy();
  for (int i = 0; i < frames; ++i) {
    for (const Effect* other : all_effects()) {
      EffectInstance noisy = instance_of(*other);
      noisy.id = "other";
      test::EffectUnderTest(noisy, capture().context).frame(*capture().channels[i], i);
    }
    run.apply(among_others[i], *capture().channels[i], i);
    EXPECT_TRUE(same(among_others[i], alone[i])) << "frame " << i;
  }
}

TEST_P(EveryEffect, DrawsAreKeyedAsDeclared) {
  const EffectInstance instance = instance_of(effect());
  CaptureContext other_seed = capture().context, other_unit = capture().context;
  other_seed.seed = 12345;
  other_unit.unit_seed = 12345;
  const std::vector<Layers> reference = apply_all(instance, busy());
  const auto differs = [&](const CaptureContext& context) {
    return !same(apply_all(instance, busy(), context).back(), reference.back());
  };
  EXPECT_EQ(differs(other_unit), declaration().per_unit_map);
  if (declaration().per_capture_map) {
    EXPECT_TRUE(differs(other_seed));
  }
  if (differs(other_seed)) {
    bool any = false;  // a single draw (repeat this frame or not) may come out alike
    for (const char* id : {"another", "a_third", "a_fourth", "a_fifth", "a_sixth", "a_seventh"}) {
      EffectInstance renamed = instance;
      renamed.id = id;
      any |= !same(apply_all(renamed, busy()).back(), reference.back());
    }
    EXPECT_TRUE(any) << "two instances share their draws";
  }
}

TEST_P(EveryEffect, LooksElsewhereInTheFirstStageOrNotAtAll) {
  const auto run = effect().begin(instance_of(effect()), capture().context);
  EXPECT_EQ(dynamic_cast<const OtherView*>(run.get()) != nullptr, declaration().stage == Stage::view);
}

TEST_P(EveryEffect, ReasonsAreOnlyGained) {
  const std::vector<Layers> before = busy(), after = apply_all(instance_of(effect()), busy());
  for (int i = 0; i < frames; ++i) {
    for (int row = 0; row < before[i].reason.rows; ++row) {
      for (int col = 0; col < before[i].reason.cols; ++col) {
        const int was = before[i].reason.at<std::uint8_t>(row, col), is = after[i].reason.at<std::uint8_t>(row, col);
        if (was == is || declaration().may_clear || declaration().user_defined) continue;
        ASSERT_EQ(was, 0) << "a reason was cleared or changed at (" << col << ", " << row << ")";
        ASSERT_TRUE(declaration().reason) << "invalidates without declaring a reason";
        ASSERT_EQ(is, static_cast<int>(*declaration().reason));
      }
    }
  }
}

TEST_P(EveryEffect, InvalidPixelsNeverLeak) {
  const EffectInstance instance = instance_of(effect());
  const std::vector<Layers> reference = apply_all(instance, busy(0));
  for (const float garbage : {-7.f, 700.f, 12345.f}) {
    const std::vector<Layers> other = apply_all(instance, busy(garbage));
    for (int i = 0; i < frames; ++i) {
      ASSERT_TRUE(same_bytes(reference[i].reason, other[i].reason)) << "frame " << i << ", garbage " << garbage;
      const cv::Mat valid = reference[i].reason == 0;
      ASSERT_EQ(cv::norm(reference[i].depth_mm, other[i].depth_mm, cv::NORM_INF, valid), 0) << "garbage " << garbage;
      ASSERT_EQ(cv::norm(reference[i].noise_mm, other[i].noise_mm, cv::NORM_INF, valid), 0) << "garbage " << garbage;
      ASSERT_EQ(cv::norm(reference[i].sigma_scale, other[i].sigma_scale, cv::NORM_INF, valid), 0);
    }
  }
}

TEST_P(EveryEffect, StaysWithinItsNeighbourhood) {
  const int reach = declaration().neighbourhood_px;
  if (reach < 0) return;
  const EffectInstance instance = instance_of(effect());
  const cv::Point touched(48, 36);
  std::vector<Layers> changed = busy();
  for (Layers& layers : changed) {
    layers.reason.at<std::uint8_t>(touched) = 0;
    layers.depth_mm.at<float>(touched) = 640.f;
  }
  const std::vector<Layers> reference = apply_all(instance, busy()), other = apply_all(instance, changed);
  for (int i = 0; i < frames; ++i) {
    for (int row = 0; row < reference[i].reason.rows; ++row) {
      for (int col = 0; col < reference[i].reason.cols; ++col) {
        if (std::max(std::abs(row - touched.y), std::abs(col - touched.x)) <= reach) continue;
        ASSERT_EQ(reference[i].depth_mm.at<float>(row, col), other[i].depth_mm.at<float>(row, col))
            << "at (" << col << ", " << row << "), declared reach " << reach;
      }
    }
  }
}

TEST_P(EveryEffect, ReadsOnlyTheChannelsItDeclares) {
  const EffectInstance instance = instance_of(effect());
  const ChannelSet reads = effect().channels_read(instance);
  Channels few = *capture().channels[0];
  const std::vector<std::pair<Channel, cv::Mat*>> images{{Channel::normal, &few.normal},
                                                         {Channel::cos_incidence, &few.cos_incidence},
                                                         {Channel::instance, &few.instance},
                                                         {Channel::projector_gap, &few.projector_gap_mm},
                                                         {Channel::diffuse, &few.diffuse},
                                                         {Channel::specular, &few.specular},
                                                         {Channel::ir, &few.ir},
                                                         {Channel::edge_distance, &few.edge_px},
                                                         {Channel::crease_distance, &few.crease_px},
                                                         {Channel::rgb, &few.rgb}};
  for (const auto& [channel, image] : images) {
    if (!contains(reads, channel)) *image = cv::Mat();
  }
  Layers layers = busy_layers(0, 0);
  test::EffectUnderTest(instance, capture().context).apply(layers, few);
  EXPECT_TRUE(same(layers, apply_all(instance, busy())[0]));
}

TEST_P(EveryEffect, StateDiesWithTheCapture) {
  const EffectInstance instance = instance_of(effect());
  CaptureContext second = capture().context;
  second.capture_key = hash_text("test/2");
  const std::vector<Layers> fresh = apply_all(instance, busy(), second);
  apply_all(instance, busy());
  const std::vector<Layers> after_another = apply_all(instance, busy(), second);
  for (int i = 0; i < frames; ++i) EXPECT_TRUE(same(fresh[i], after_another[i])) << "frame " << i;
}

TEST_P(EveryEffect, DepthIsStoredInSteps) {
  CaptureContext coarse = capture().context;
  coarse.depth_scale_mm = 0.25;
  for (const Frame& frame : simulate(model_of({instance_of(effect())}), coarse)) {
    for (int row = 0; row < frame.depth_mm.rows; ++row) {
      for (int col = 0; col < frame.depth_mm.cols; ++col) {
        const float steps = frame.depth_mm.at<float>(row, col) / 0.25f;
        ASSERT_EQ(steps, std::round(steps));
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Catalogue, EveryEffect, testing::ValuesIn(all_effects()),
                         [](const auto& info) { return info.param->declaration.name; });

TEST(EffectTable, NamesAreUniqueAndSorted) {
  const std::vector<std::string> names = effect_catalogue().names();
  for (std::size_t i = 1; i < names.size(); ++i) EXPECT_LT(names[i - 1], names[i]);
  for (const std::string& name : names) EXPECT_EQ(find_effect(name)->declaration.name, name);
  EXPECT_EQ(find_effect("no_such_effect"), nullptr);
}

TEST(EffectOrder, AgainstTheStagesIsRefusedWithTheReason) {
  SensorModel model;
  model.effects = {test::make_instance("bilateral_blur"), test::make_instance("projector_shadow")};
  try {
    check_sensor_model(model, effect_catalogue());
    FAIL() << "was accepted";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("signal_mask"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("spatial"), std::string::npos) << error.what();
  }
}

TEST(EffectOrder, TheWholeCatalogueAtOnceGivesOneAndTheSameFrame) {
  std::vector<EffectInstance> all, reversed;
  for (const Effect* effect : all_effects()) {
    EffectInstance instance = instance_of(*effect, Strength::weak);
    all.push_back(instance);
    reversed.insert(reversed.begin(), instance);
  }
  const std::vector<Frame> frames_of_all = simulate(model_of(all));
  EXPECT_TRUE(same(frames_of_all, simulate(model_of(all))));
  // The other order inside every stage is a sensor as well, and a different one.
  EXPECT_FALSE(same(frames_of_all, simulate(model_of(reversed))));
  const cv::Mat measured = frames_of_all[0].reason == static_cast<int>(Reason::measured);
  EXPECT_GT(cv::countNonZero(measured), 1000);
}

TEST(EffectOrder, InsideAStageTheModelFileDecides) {
  const EffectInstance scale = test::make_instance("depth_scale", {{"scale", 0.1}}),
                       offset = test::make_instance("depth_offset", {{"offset", 20}});
  const Frame first = simulate(model_of({scale, offset}))[0], second = simulate(model_of({offset, scale}))[0];
  // (z + 20) 1.1 - (1.1 z + 20) = 2 mm, in storage steps of 0.02 mm.
  const cv::Mat both = (first.depth_mm > 0) & (second.depth_mm > 0);
  EXPECT_NEAR(cv::mean(second.depth_mm - first.depth_mm, both)[0], 2, 0.02);
}

TEST(EffectNeeds, UnmetOnesAreListedAndAnErrorWhereTheModelWritesTheCamera) {
  CaptureContext no_projector = capture().context;
  no_projector.projector_xyz_mm.reset();
  SensorModel model = model_of({test::make_instance("projector_shadow")});
  const SensorRun run(model, no_projector);
  ASSERT_EQ(run.inactive().size(), 1u);
  EXPECT_EQ(run.inactive()[0].first, "projector_shadow");
  EXPECT_NE(run.inactive()[0].second.find("baseline"), std::string::npos);
  model.camera_from = Given::written;
  model.effects[0].where = "model.yaml:7";
  try {
    SensorRun refused(model, no_projector);
    FAIL() << "was accepted";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("model.yaml:7"), std::string::npos) << error.what();
  }
}

TEST(StorageStage, DepthsThatDoNotFitAreOutOfRange) {
  CaptureContext context = capture().context;
  context.depth_scale_mm = 0.01;  // 16 bits end at 655.35 mm
  SensorRun run(model_of({}), context);
  const Frame frame = run.frame(*capture().channels[0], {});
  frame.check("frame");
  for (int row = 0; row < frame.depth_mm.rows; ++row) {
    for (int col = 0; col < frame.depth_mm.cols; ++col) {
      const float perfect = capture().channels[0]->depth_mm.at<float>(row, col);
      if (perfect > 655.36f) {
        EXPECT_EQ(frame.reason.at<std::uint8_t>(row, col), static_cast<int>(Reason::out_of_range));
      }
    }
  }
}

}  // namespace
}  // namespace binrig
