// Inner products in which nuisances do not count: poses, intrinsics, and the parameters that the model already has are
// marginalised with their priors (DIAGNOSIS.md section 2; in a linear Gaussian model, marginalising x with precision P
// out of y = N x + noise turns the metric W = 1 into Q = 1 - N (N'N + P)^-1 N').
#pragma once

#include <functional>
#include <vector>

#include <Eigen/Core>

#include "diagnose/standard.h"

namespace binrig {

/// A nuisance: what y moves by when it moves by one unit of its prior's standard deviation.
struct NuisanceRow {
  Whitened change;
  int capture = -1;  ///< the one capture that it touches; -1 = all
  /// The prior is an uncertainty that somebody stated, not a wide guess: far away is a misfit.
  bool stated = false;
};

/// Mean squares, in prior sigmas, of the nuisances with a stated uncertainty: about 1 or less where things are as they
/// are said to be. 0 if there are none.
struct Stated {
  double poses = 0;       ///< of those of single captures
  double intrinsics = 0;  ///< of those that all captures share
};

/// A residual with the nuisances at their most probable values.
struct Explained {
  Whitened rest;   ///< what they leave, compressed; zero in captures that do not count
  double chi = 0;  ///< square of the rest, plus the prior's part, less that of the noise
  double noise = 0;  ///< what was taken off for it
  Stated stated;
  double shared_prior = 0;     ///< sum of squares of the stated ones that all captures share
  std::vector<double> values;  ///< of the nuisances, in the order of the rows, from the prior's centre
  Eigen::VectorXd global;      ///< those of the global rows
};

class Metric {
 public:
  Metric() = default;
  /// `part`: only these captures count. `global_precision`: prior precision of the global rows in their order (in units
  /// of one prior standard deviation); empty = identity.
  Metric(const Layout& layout, Part part, const std::vector<NuisanceRow>& rows,
         const Eigen::MatrixXd& global_precision = {});

  /// Q v, zero in captures that do not count.
  Whitened apply(const Whitened& v) const;
  /// The same, with the nuisances' values that it takes out.
  Whitened apply(const Whitened& v, std::vector<double>& values) const;
  /// What the nuisances' prior makes of values of theirs: with it, Qv . Qw + prior_product is v . Qw.
  double prior_product(const std::vector<double>& a, const std::vector<double>& b) const;
  /// Most probable values of the nuisances given y, in the order of the rows given (pose rows of captures that do not
  /// count: 0).
  std::vector<double> estimate(const Whitened& y) const;
  /// Takes the nuisances out of a residual (Standard::linear, not compressed: a pose that is far off must not be
  /// mistaken for something else because it was squeezed first). `place`: where the nuisances stand in the residual,
  /// in prior sigmas from nominal, by row; empty = nominal. The prior is centred on nominal, so that a hypothesis that
  /// needs no shift of the targets is the better for it; `global_centre`, if given, is where the global rows' prior is
  /// centred instead (what another part of the data says). `noise`: residuals that are no misfit
  /// (deviations of few simulations from their mean, scaled to its error); what they would add to chi, compressed as it
  /// is, is taken off.
  Explained explain(const Whitened& residual, const std::vector<double>& place = {},
                    const Eigen::VectorXd& global_centre = {}, const std::vector<Whitened>& noise = {}) const;
  /// Posterior precision of the global rows: their prior for another part of the data.
  const Eigen::MatrixXd& global_posterior() const { return posterior_; }
  /// The same for residuals on another scale: `changed` is a linear map of every block onto itself, from whitened vectors
  /// of the layout's size to such. `global_precision`: as that of the constructor; empty = as it is.
  Metric on_scale(const std::function<Whitened(const Whitened&)>& changed,
                  const Eigen::MatrixXd& global_precision = {}) const;
  /// The same with some nuisances that all captures share (rows of the list given) held at their prior's centre.
  Metric with_held(const std::vector<int>& rows) const;
  Part part() const { return part_; }

 private:
  struct Group {
    int begin = 0, end = 0;   // span of the capture in the vector
    std::vector<int> rows;    // index in the list given
    Eigen::MatrixXf change;   // rows x span
    Eigen::MatrixXd inverse;  // (N N' + 1)^-1
  };
  static void invert(Group& group);
  void weigh_global();
  void apply_local(Whitened& v) const;
  /// Takes the nuisances' most probable values out of a residual at the prior's centre, not compressed; returns the
  /// prior's part of chi.
  double project(Whitened& rest, std::vector<double>* values, Eigen::VectorXd* global) const;

  Part part_ = Part::all;
  std::vector<std::pair<int, int>> spans_;  // that count
  std::vector<Group> groups_;
  std::vector<int> global_index_;
  std::vector<bool> stated_;                       // by row
  std::vector<Whitened> global_, global_applied_;  // rows, and Q_local of them
  Eigen::MatrixXd prior_, posterior_, inverse_;
  std::size_t size_ = 0, row_count_ = 0;
};

}  // namespace binrig
