// What a hypothesis leaves, simulated on top of a rung.
#include "diagnose/refine.h"

#include <gtest/gtest.h>

#include "tests/diagnose/simulated_case.h"

namespace binrig {
namespace {

TEST(Remainder, KnowsHowFarAModelsOwnRecordingsScatter) {
  // Patches wider than a cell of the bias maps put a map of chance into each capture of a tilted target.
  const Case c(noise_alone(0.3), noise_alone(0.3));
  const Rung rung = c.fitted({.simulations = 12, .passes = 1});
  Refiner refiner{c.experiment, c.motions, rung, c.measured};
  refiner.seeds = 4;
  const auto remainder = [&](double hold) {
    SensorModel model = rung.model;
    add_effect(model, effect_catalogue(), "fronto_parallel_patches", {{"hold", hold}, {"slant", 0.2}, {"pitch", 8}});
    return remainder_of(refiner, model, rung.offsets, rung.place);
  };
  const Remainder none = remainder(0), some = remainder(0.3), more = remainder(0.6);
  // The recording is one of the model's: it is as far from their mean as they are. Compressed, a normal value's square
  // is a little less than 1, and the practical floors take their part of both.
  EXPECT_NEAR(none.scatter, none.train, 0.1 * none.train);
  EXPECT_GT(some.scatter, 1.5 * none.scatter);
  EXPECT_GT(more.scatter, some.scatter);
}

}  // namespace
}  // namespace binrig
