// Where a model fails: maps and curves of measured against simulated statistics, before effects were added and after,
// in units that a user knows.
#pragma once

#include <string>
#include <vector>

#include "diagnose/diagnose.h"
#include "diagnose/rung.h"

namespace binrig {

class Where {
 public:
  /// `first` and `last`: rungs of the model given and of the last one; the same one where nothing was added. `last` has
  /// its nulls and metrics still (no leave_behind). `measured`: stabilised, of the experiment's layout. All are kept by
  /// reference.
  Where(const Experiment& experiment, const std::vector<SceneMotion>& motions, const StatVector& measured,
        const Rung& first, const Rung& last);

  /// Bias of six captures, noise and drop-outs of two each: those in which most is left by the model given.
  std::vector<Maps> maps() const;
  /// Bias, noise and drop-outs over the two covariates that the model given goes wrong with most, beyond the last
  /// model's randomness, and what stands for frequencies over these. Captures held out only; empty where there are
  /// none.
  std::vector<Course> courses() const;

 private:
  struct Plain;
  struct Class {
    double at = 0;
    std::vector<int> elements;
  };
  static const std::vector<Plain>& plain_units();
  /// Of an element, as Plain::change has it; NaN where it is not known.
  double change(const Plain& plain, int element, bool last) const;
  Course course(const Plain& plain, const std::vector<Class>& classes) const;
  std::vector<Course> over_covariates(const Plain& plain) const;
  Course over_frequency(const Plain& plain, int segment) const;

  const Experiment& experiment_;
  const StatVector& measured_;
  const Rung &first_, &last_;
  StatVector first_left_, last_left_;  // measured less simulated, stabilised, targets registered
  std::vector<StatVector> own_;        // what the last model's own simulations leave, on the same scale
};

}  // namespace binrig
