#include "diagnose/edge_registration.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnose/mean_of_simulations.h"
#include "diagnose/score.h"
#include "diagnose/trace.h"

namespace binrig {
namespace {

constexpr int seeds = 4;
constexpr double worth_it = 9;  // of a square: three standard deviations of one motion
constexpr int most_steps = 3;   // of one motion in one direction
constexpr int most_walks = 6;   // over all motions, as long as one takes a twentieth off the square

/// Walks the target of one capture.
class Walk {
 public:
  Walk(const Experiment& experiment, const std::vector<SceneMotion>& motions, const Rung& rung, int capture,
       std::uint64_t seed)
      : experiment_(experiment),
        motions_(motions),
        rung_(rung),
        capture_(capture),
        seed_(seed),
        offsets_(rung.offsets),
        square_(square_at(offsets_)) {}

  void run() {
    const double before = square_;
    double last = 0;
    for (int walk = 0; walk < most_walks && (walk == 0 || square_ < 0.95 * last); ++walk) {
      last = square_;
      over_all_motions();
    }
    if (tracing())
      fmt::print(stderr, "  capture {} registered by its edges: square {:.0f} -> {:.0f}\n", capture_, before, square_);
  }

  const std::vector<Offset>& offsets() const { return offsets_; }

 private:
  void over_all_motions() {
    for (const int element : {3, 4, 5, 0, 1, 2})  // shifts first
      for (std::size_t m = 0; m < motions_.size(); ++m)
        if (motions_[m].capture == capture_ && motions_[m].element == element)
          for (const double reach : reaches())
            for (const double direction : {1.0, -1.0})
              for (int k = 0; k < most_steps && goes(m, direction * reach * registered_to(motions_[m])); ++k) {
              }
  }

  /// In units of what a motion is registered to, far first where the target is far from where it should be: a plane
  /// between two coarse steps looks the same wherever it stands there.
  std::vector<double> reaches() const {
    constexpr double far_out = 5;  // of an element's mean square
    int known = 0;
    for (const Block& block : experiment_.layout().blocks)
      if (block.capture == capture_)
        known += static_cast<int>(std::count_if(rung_.standard.spread().begin() + block.offset,
                                                rung_.standard.spread().begin() + block.offset + block.size,
                                                [](float spread) { return spread > 0; }));
    if (square_ > far_out * known) return {8, 4, 2, 1, 0.5};
    return {1, 0.5};
  }

  bool goes(std::size_t m, double by) {
    std::vector<double> step(motions_.size(), 0);
    step[m] = by;
    const auto offsets = offsets_of(experiment_.layout(), motions_, step, offsets_);
    const double square = square_at(offsets);
    if (square > square_ - worth_it) return false;
    square_ = square;
    offsets_ = offsets;
    return true;
  }

  /// What is left of the capture, and what its pose costs.
  double square_at(const std::vector<Offset>& offsets) const {
    std::vector<Trial> trials;
    for (int k = 0; k < seeds; ++k) {
      trials.push_back({rung_.model, offsets, seed_ + static_cast<std::uint64_t>(k)});
      trials.back().only = {capture_};
    }
    const auto simulations = simulate_typical_units(experiment_, trials, "registering by edges");
    Whitened rest = mean_of(rung_.standard, simulations).mean;
    for (std::size_t i = 0; i < rest.size(); ++i) rest[i] = rung_.data[i] - rest[i];
    compress(rest);
    double square = squares_beside_bias(experiment_.layout(), rest)[capture_];
    const auto place = values_of(motions_, offsets);
    for (std::size_t m = 0; m < motions_.size(); ++m)
      if (motions_[m].capture == capture_) square += place[m] * place[m];
    return square;
  }

  const Experiment& experiment_;
  const std::vector<SceneMotion>& motions_;
  const Rung& rung_;
  const int capture_;
  const std::uint64_t seed_;
  std::vector<Offset> offsets_;
  double square_;
};

}  // namespace

bool register_by_edges(const Experiment& experiment, const std::vector<SceneMotion>& motions,
                       const Measurement& measured, const RungOptions& options, Rung& rung) {
  constexpr int registrations = 3;        // a target that stands better teaches the spread that its place is judged by
  constexpr double worth_another = 0.01;  // of the proper score, an element
  const Layout& layout = experiment.layout();
  std::vector<int> captures = captures_that_stand_out(layout, rung);
  bool another = false;
  for (int k = 0; k < registrations; ++k) {
    std::vector<Offset> offsets = rung.offsets;
    std::vector<int> moved;
    for (const int capture : captures) {
      Walk walk(experiment, motions, rung, capture, options.seed + 700);
      walk.run();
      if (walk.offsets()[capture] == rung.offsets[capture]) continue;
      moved.push_back(capture);
      offsets[capture] = walk.offsets()[capture];
    }
    if (moved.empty()) break;
    Rung next = made_anew(experiment, motions, measured, rung.model, offsets, options, rung.fit.parameters);
    const double now = proper_score(layout, rung, Part::all), then = proper_score(layout, next, Part::all);
    if (tracing()) fmt::print(stderr, "  registered by edges: proper {:.4f} -> {:.4f}\n", now, then);
    if (then >= now) break;
    rung = std::move(next);
    another = true;
    if (then > now - worth_another) break;
    captures = std::move(moved);
  }
  return another;
}

}  // namespace binrig
