#include "diagnose/settle.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnose/last_step.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr double near_enough = 6;  // standard deviations: chance makes half of that of a dozen parameters,
constexpr int few_steps = 2, most_steps = 6;
constexpr double worth_it = 0.001;  // of the proper score, an element: promised for less, no step is taken; it ends it,
constexpr double far_yet = 0.01;    // and from the second step on less than this does

}  // namespace

void settle_down(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Measurement& measured,
                 const RungOptions& options, Rung& rung) {
  const std::vector<FitParameter> priors = rung.fit.parameters;
  const bool series = needs_whole_series(rung.model, experiment.forward().catalogue());
  double known = 0;  // elements, on train
  for (const Block& block : experiment.layout().blocks)
    if (block.train)
      known += static_cast<double>(std::count_if(rung.rest.begin() + block.offset,
                                                 rung.rest.begin() + block.offset + block.size,
                                                 [](float v) { return v != 0; }));
  const double least_length = std::max(near_enough, std::sqrt(worth_it * known));
  double share = 1;  // of a step
  for (int k = 0; k < most_steps; ++k) {
    const LastStep step = last_step(experiment, motions, rung, priors, series, options.seed);
    if (share * step.length < least_length) return;
    Rung next = made_anew(experiment, motions, measured, stepped(step, priors, share), rung.offsets, options, priors);
    const double now = proper_score(experiment.layout(), rung, Part::train),
                 then = proper_score(experiment.layout(), next, Part::train);
    if (tracing()) fmt::print(stderr, "  settling: proper on train {:.4f} -> {:.4f}\n", now, then);
    const double gained = now - then;
    if (gained > 0)
      rung = std::move(next);
    else
      share /= 2;
    const bool done = k + 1 < few_steps ? gained >= 0 && gained < worth_it : gained < far_yet;
    if (done) return;
  }
}

}  // namespace binrig
