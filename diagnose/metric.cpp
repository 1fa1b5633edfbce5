#include "diagnose/metric.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <map>

namespace binrig {

Metric::Metric(const Layout& layout, Part part, const std::vector<NuisanceRow>& rows,
               const Eigen::MatrixXd& global_precision)
    : part_(part), size_(layout.size), row_count_(rows.size()) {
  for (const NuisanceRow& row : rows) stated_.push_back(row.stated);
  std::map<int, std::pair<int, int>> span;
  for (const auto& block : layout.blocks) {
    const bool counts = part == Part::all || (part == Part::train) == block.train;
    if (!counts) continue;
    auto [at, fresh] = span.try_emplace(block.capture, block.offset, block.offset + block.size);
    if (!fresh) at->second.second = block.offset + block.size;
  }
  for (const auto& [capture, range] : span) spans_.push_back(range);
  for (const auto& [capture, range] : span) {
    Group group;
    group.begin = range.first;
    group.end = range.second;
    for (std::size_t r = 0; r < rows.size(); ++r)
      if (rows[r].capture == capture) group.rows.push_back(static_cast<int>(r));
    if (group.rows.empty()) continue;
    const int n = static_cast<int>(group.rows.size());
    group.change.resize(n, group.end - group.begin);
    for (int r = 0; r < n; ++r)
      group.change.row(r) = Eigen::Map<const Eigen::RowVectorXf>(rows[group.rows[r]].change.data() + group.begin,
                                                                 group.end - group.begin);
    invert(group);
    groups_.push_back(std::move(group));
  }
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (rows[r].capture < 0) {
      global_index_.push_back(static_cast<int>(r));
      global_.push_back(rows[r].change);
    }
  const auto g = static_cast<Eigen::Index>(global_.size());
  prior_ = global_precision.size() ? global_precision : Eigen::MatrixXd::Identity(g, g).eval();
  weigh_global();
}

void Metric::invert(Group& group) {
  const Eigen::Index n = group.change.rows();
  const Eigen::MatrixXd information =
      (group.change * group.change.transpose()).cast<double>() + Eigen::MatrixXd::Identity(n, n);
  group.inverse = information.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
}

/// From the global rows and their prior, and the groups.
void Metric::weigh_global() {
  const int g = static_cast<int>(global_.size());
  global_applied_ = global_;
  for (Whitened& row : global_applied_) apply_local(row);
  posterior_ = prior_;
  for (int a = 0; a < g; ++a)
    for (int b = 0; b < g; ++b) posterior_(a, b) += dot(global_[a], global_applied_[b]);
  posterior_ = (0.5 * (posterior_ + posterior_.transpose())).eval();
  if (g > 0) inverse_ = posterior_.ldlt().solve(Eigen::MatrixXd::Identity(g, g));
}

void Metric::apply_local(Whitened& v) const {
  Whitened result(size_, 0.f);
  for (const auto& [begin, end] : spans_) std::copy(v.begin() + begin, v.begin() + end, result.begin() + begin);
  for (const auto& group : groups_) {
    Eigen::Map<Eigen::VectorXf> part(result.data() + group.begin, group.end - group.begin);
    const Eigen::VectorXd x = group.inverse * (group.change * part).cast<double>();
    part -= group.change.transpose() * x.cast<float>();
  }
  v = std::move(result);
}

Metric Metric::on_scale(const std::function<Whitened(const Whitened&)>& changed,
                        const Eigen::MatrixXd& global_precision) const {
  Metric result = *this;
  for (Group& group : result.groups_) {
    for (Eigen::Index r = 0; r < group.change.rows(); ++r) {
      Whitened row(size_, 0.f);
      Eigen::Map<Eigen::RowVectorXf> own(row.data() + group.begin, group.end - group.begin);
      own = group.change.row(r);
      row = changed(row);
      group.change.row(r) = Eigen::Map<const Eigen::RowVectorXf>(row.data() + group.begin, group.end - group.begin);
    }
    invert(group);
  }
  for (Whitened& row : result.global_) row = changed(row);
  if (global_precision.size()) result.prior_ = global_precision;
  result.weigh_global();
  return result;
}

Metric Metric::with_held(const std::vector<int>& rows) const {
  Metric result = *this;
  std::vector<int> free;
  for (int k = 0; k < static_cast<int>(global_index_.size()); ++k)
    if (std::find(rows.begin(), rows.end(), global_index_[k]) == rows.end()) free.push_back(k);
  if (free.size() == global_index_.size()) return result;
  const auto kept = [&](const auto& all) {
    std::decay_t<decltype(all)> some;
    for (const int k : free) some.push_back(all[k]);
    return some;
  };
  result.global_index_ = kept(global_index_);
  result.global_ = kept(global_);
  result.global_applied_ = kept(global_applied_);
  result.prior_ = prior_(free, free);
  result.posterior_ = posterior_(free, free);
  const auto g = static_cast<Eigen::Index>(free.size());
  result.inverse_ = result.posterior_.ldlt().solve(Eigen::MatrixXd::Identity(g, g));
  return result;
}

Whitened Metric::apply(const Whitened& v) const {
  Whitened result = v;
  apply_local(result);
  const int g = static_cast<int>(global_.size());
  if (g == 0) return result;
  Eigen::VectorXd b(g);
  for (int k = 0; k < g; ++k) b[k] = dot(global_[k], result);
  const Eigen::VectorXd x = inverse_ * b;
  for (int k = 0; k < g; ++k) {
    const float a = static_cast<float>(x[k]);
    for (std::size_t i = 0; i < size_; ++i) result[i] -= a * global_applied_[k][i];
  }
  return result;
}

Whitened Metric::apply(const Whitened& v, std::vector<double>& values) const {
  Whitened result(size_, 0.f);
  for (const auto& [begin, end] : spans_) std::copy(v.begin() + begin, v.begin() + end, result.begin() + begin);
  values.assign(row_count_, 0);
  project(result, &values, nullptr);
  return result;
}

double Metric::prior_product(const std::vector<double>& a, const std::vector<double>& b) const {
  double sum = 0;
  for (const auto& group : groups_)
    for (const int row : group.rows) sum += a[row] * b[row];
  for (std::size_t k = 0; k < global_index_.size(); ++k)
    for (std::size_t l = 0; l < global_index_.size(); ++l)
      sum += a[global_index_[k]] * prior_(static_cast<int>(k), static_cast<int>(l)) * b[global_index_[l]];
  return sum;
}

std::vector<double> Metric::estimate(const Whitened& y) const { return explain(y).values; }

double Metric::project(Whitened& rest, std::vector<double>* values, Eigen::VectorXd* global) const {
  const int g = static_cast<int>(global_.size());
  double prior = 0;
  if (g > 0) {
    Eigen::VectorXd b(g);
    for (int k = 0; k < g; ++k) b[k] = dot(global_applied_[k], rest);
    const Eigen::VectorXd x = inverse_ * b;
    for (int k = 0; k < g; ++k) {
      const float a = static_cast<float>(x[k]);
      for (const auto& [begin, end] : spans_)
        for (int i = begin; i < end; ++i) rest[i] -= a * global_[k][i];
      if (values) (*values)[global_index_[k]] = x[k];
    }
    if (global) *global = x;
    prior += x.dot(prior_ * x);
  }
  for (const auto& group : groups_) {
    Eigen::Map<Eigen::VectorXf> part(rest.data() + group.begin, group.end - group.begin);
    const Eigen::VectorXd x = group.inverse * (group.change * part).cast<double>();
    part -= group.change.transpose() * x.cast<float>();
    for (std::size_t r = 0; values && r < group.rows.size(); ++r) (*values)[group.rows[r]] = x[static_cast<int>(r)];
    prior += x.squaredNorm();
  }
  return prior;
}

Explained Metric::explain(const Whitened& residual, const std::vector<double>& place,
                          const Eigen::VectorXd& global_centre, const std::vector<Whitened>& noise) const {
  constexpr float largest = 200.f;  // beyond: nothing that a small motion does
  const int g = static_cast<int>(global_.size());
  const auto at = [&](int row) { return place.empty() ? 0.0 : place[row]; };
  Explained result;
  result.values.assign(row_count_, 0);
  result.global = Eigen::VectorXd::Zero(g);
  // As if every nuisance stood at its prior's centre.
  const auto counted = [&](const Whitened& v) {
    Whitened part(size_, 0.f);
    for (const auto& [begin, end] : spans_)
      for (int i = begin; i < end; ++i) part[i] = std::clamp(v[i], -largest, largest);
    return part;
  };
  result.rest = counted(residual);
  Whitened& rest = result.rest;
  for (int k = 0; k < g; ++k) {
    const float a = static_cast<float>(at(global_index_[k]) - (global_centre.size() ? global_centre[k] : 0.0));
    if (a == 0) continue;
    for (const auto& [begin, end] : spans_)
      for (int i = begin; i < end; ++i) rest[i] += a * global_[k][i];
  }
  for (const auto& group : groups_) {
    Eigen::VectorXf x(group.rows.size());
    for (std::size_t r = 0; r < group.rows.size(); ++r) x[static_cast<int>(r)] = static_cast<float>(at(group.rows[r]));
    if (x.isZero()) continue;
    Eigen::Map<Eigen::VectorXf>(rest.data() + group.begin, group.end - group.begin) += group.change.transpose() * x;
  }
  result.chi = project(rest, &result.values, &result.global);
  if (global_centre.size()) {
    result.global += global_centre;
    for (int k = 0; k < g; ++k) result.values[global_index_[k]] = result.global[k];
  }
  double local_prior = 0, local = 0, shared = 0;
  const auto add = [&](int row, double& sum, double& count) {
    if (stated_[row]) sum += result.values[row] * result.values[row], count += 1;
  };
  for (const auto& group : groups_)
    for (int row : group.rows) add(row, local_prior, local);
  for (int row : global_index_) add(row, result.shared_prior, shared);
  result.stated = {local_prior / std::max(1.0, local), result.shared_prior / std::max(1.0, shared)};
  compress(rest);
  for (const auto& [begin, end] : spans_)
    for (int i = begin; i < end; ++i) result.chi += static_cast<double>(rest[i]) * rest[i];
  for (const Whitened& one : noise) {
    Whitened part = counted(one);
    result.noise += project(part, nullptr, nullptr);
    compress(part);  // like what it is in; else simulations that scatter wildly would explain anything
    for (const auto& [begin, end] : spans_)
      for (int i = begin; i < end; ++i) {
        const double p = compression_slope(rest[i]) * part[i];
        result.noise += p * p;
      }
  }
  result.chi -= result.noise;
  return result;
}

}  // namespace binrig
