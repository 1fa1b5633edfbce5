#include "diagnose/metric.h"

#include <Eigen/Cholesky>
#include <map>

namespace binrig {

Metric::Metric(const Layout& layout, Part part, const std::vector<NuisanceRow>& rows,
               const Eigen::MatrixXd& global_precision)
    : part_(part), size_(layout.size), row_count_(rows.size()) {
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
    const Eigen::MatrixXd information =
        (group.change * group.change.transpose()).cast<double>() + Eigen::MatrixXd::Identity(n, n);
    group.inverse = information.ldlt().solve(Eigen::MatrixXd::Identity(n, n));
    groups_.push_back(std::move(group));
  }
  for (std::size_t r = 0; r < rows.size(); ++r)
    if (rows[r].capture < 0) {
      global_index_.push_back(static_cast<int>(r));
      global_.push_back(rows[r].change);
      global_applied_.push_back(rows[r].change);
      apply_local(global_applied_.back());
    }
  const int g = static_cast<int>(global_.size());
  posterior_ = global_precision.size() ? global_precision : Eigen::MatrixXd::Identity(g, g).eval();
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

std::vector<double> Metric::estimate(const Whitened& y) const {
  std::vector<double> values(row_count_, 0);
  Whitened local = y;
  apply_local(local);
  const int g = static_cast<int>(global_.size());
  Whitened rest(size_, 0.f);
  for (const auto& [begin, end] : spans_) std::copy(y.begin() + begin, y.begin() + end, rest.begin() + begin);
  if (g > 0) {
    Eigen::VectorXd b(g);
    for (int k = 0; k < g; ++k) b[k] = dot(global_[k], local);
    const Eigen::VectorXd x = inverse_ * b;
    for (int k = 0; k < g; ++k) {
      values[global_index_[k]] = x[k];
      const float a = static_cast<float>(x[k]);
      for (std::size_t i = 0; i < size_; ++i) rest[i] -= a * global_[k][i];
    }
  }
  for (const auto& group : groups_) {
    Eigen::Map<const Eigen::VectorXf> part(rest.data() + group.begin, group.end - group.begin);
    const Eigen::VectorXd x = group.inverse * (group.change * part).cast<double>();
    for (std::size_t r = 0; r < group.rows.size(); ++r) values[group.rows[r]] = x[static_cast<int>(r)];
  }
  return values;
}

}  // namespace binrig
