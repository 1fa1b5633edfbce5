#include "diagnose/capture_by_capture.h"

#include <cmath>

#include <Eigen/Eigenvalues>

#include "diagnose/last_step.h"
#include "diagnose/unit_map.h"

namespace binrig {
namespace {

constexpr double least_direction = 0.01;  // of the square of the longest: shorter ones are the derivatives' noise

/// Orthonormal directions in a block of y along which some derivatives lead.
Eigen::MatrixXf directions_in(const Block& block, const std::vector<Whitened>& slopes) {
  Eigen::MatrixXf change(block.size, static_cast<int>(slopes.size()));
  for (int p = 0; p < change.cols(); ++p)
    change.col(p) = Eigen::Map<const Eigen::VectorXf>(slopes[p].data() + block.offset, block.size);
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXf> own(change.transpose() * change);
  const float longest = own.eigenvalues().maxCoeff();
  Eigen::MatrixXf directions(block.size, 0);
  for (int k = 0; k < own.eigenvalues().size(); ++k) {
    if (longest <= 0 || own.eigenvalues()[k] < least_direction * longest) continue;
    directions.conservativeResize(Eigen::NoChange, directions.cols() + 1);
    directions.rightCols(1) = change * own.eigenvectors().col(k) / std::sqrt(own.eigenvalues()[k]);
  }
  return directions;
}

}  // namespace

WantedOtherwise wanted_otherwise(const Layout& layout, const Rung& rung, const std::string& id) {
  std::vector<Whitened> slopes;
  for (std::size_t p = 0; p < rung.fit.parameters.size(); ++p) {
    const FitParameter& parameter = rung.fit.parameters[p];
    if (parameter.id != id || silent(rung.fit.slopes[p])) continue;
    slopes.push_back(rung.fit.slopes[p]);
    for (float& v : slopes.back()) v *= static_cast<float>(prior_deviation(parameter));
  }
  if (slopes.empty()) return {};
  std::vector<std::pair<int, Eigen::MatrixXf>> by_block;  // offset
  for (const Block& block : layout.blocks)
    if (segments()[block.segment].name == "bias") by_block.emplace_back(block.offset, directions_in(block, slopes));
  const auto square_of = [&](const Whitened& rest) {
    double square = 0;
    for (const auto& [offset, directions] : by_block)
      square += (directions.transpose() * Eigen::Map<const Eigen::VectorXf>(rest.data() + offset, directions.rows()))
                    .squaredNorm();
    return square;
  };
  const std::vector<Whitened> nulls = left_of_nulls(rung);
  WantedOtherwise wanted;
  wanted.square = square_of(rung.rest);
  double second = 0;
  for (const Whitened& null : nulls) {
    const double square = square_of(null);
    wanted.by_chance += square / static_cast<double>(nulls.size());
    second += square * square / static_cast<double>(nulls.size());
  }
  wanted.deviation = std::sqrt(std::max(0.0, second - wanted.by_chance * wanted.by_chance));
  return wanted;
}

}  // namespace binrig
