#include "core/coherent_noise.h"

#include <bit>
#include <cmath>

#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "core/recent_fields.h"

namespace binrig {
namespace {

float eased(float t, LatticeWeight weight) {
  return weight == LatticeWeight::cubic ? t * t * (3.f - 2.f * t) : t * t * t * (t * (6.f * t - 15.f) + 10.f);
}

/// Where a row or column of pixels lies in its lattice: cell index, place in the cell, eased place.
struct Axis {
  Axis(int count, double cell_px, double shift, LatticeWeight weight) : cell(count), place(count), ease(count) {
    for (int i = 0; i < count; ++i) {
      const double position = i / cell_px + shift;
      cell[i] = static_cast<int>(position);
      place[i] = static_cast<float>(position - cell[i]);
      ease[i] = eased(place[i], weight);
    }
  }
  std::vector<int> cell;
  std::vector<float> place, ease;
};

/// Adds (1-w(s)) (l0 + l1 s) + w(s) (r0 + r1 s) along a run of pixels inside one cell.
void add_run(float* out, const float* s, const float* w, int count, float l0, float l1, float r0, float r1) {
  const float d0 = r0 - l0, d1 = r1 - l1;
  for (int i = 0; i < count; ++i) out[i] += l0 + l1 * s[i] + w[i] * (d0 + d1 * s[i]);
}

}  // namespace

double gradient_noise_variance(LatticeWeight weight) {
  // Midpoint sums of smooth integrands: 2000 steps leave an error below 1e-6.
  constexpr int steps = 2000;
  double a = 0, b = 0;
  for (int i = 0; i < steps; ++i) {
    const double t = (i + 0.5) / steps;
    const double w = 1.0 - eased(static_cast<float>(t), weight);
    a += w * w / steps;
    b += w * w * t * t / steps;
  }
  return 4.0 * a * b;
}

CoherentNoise::CoherentNoise(int rows, int cols, double grid_px, LatticeWeight weight)
    : rows_(rows), cols_(cols), grid_px_(grid_px), weight_(weight) {
  if (rows <= 0 || cols <= 0) throw Error("coherent noise of an empty image");
  if (!(grid_px >= 4)) {
    throw Error("coherent noise", {{"", "grid", number_text(grid_px), "px", "4 or more", "is too fine a lattice"}});
  }
  const double per_lattice = gradient_noise_variance(weight);
  double total = 0;
  for (int octave = 0; octave < 3; ++octave) total += std::pow(0.25, octave);
  for (int octave = 0; octave < 3; ++octave) {
    const double share = std::pow(0.25, octave) / total;
    lattices_.push_back({grid_px / (1 << octave), static_cast<float>(std::sqrt(share / per_lattice))});
  }
}

void CoherentNoise::add(const Lattice& lattice, const RandomStream& stream, cv::Mat& field) const {
  // Index 0 and 1 of the parent stream are the shifts; the gradients have a stream of their own.
  const Axis x(cols_, lattice.cell_px, stream.uniform(0), weight_);
  const Axis y(rows_, lattice.cell_px, stream.uniform(1), weight_);
  const int nodes_x = x.cell.back() + 2, nodes_y = y.cell.back() + 2;
  cv::Mat turns(nodes_y, nodes_x, CV_32F), gx(nodes_y, nodes_x, CV_32F), gy(nodes_y, nodes_x, CV_32F);
  stream.child("gradients").fill_uniform(turns);
  turns *= 360.f;
  cv::Mat length(nodes_y, nodes_x, CV_32F, cv::Scalar(lattice.scale));
  cv::polarToCart(length, turns, gx, gy, true);

  // Along a row each cell is linear in s on its left and on its right node, so only the easing is left per pixel.
  const auto add_row = [&](int row) {
    const int j = y.cell[row];
    const float t = y.place[row], w = y.ease[row];
    const float *gx0 = gx.ptr<float>(j), *gx1 = gx.ptr<float>(j + 1);
    const float *gy0 = gy.ptr<float>(j), *gy1 = gy.ptr<float>(j + 1);
    float* out = field.ptr<float>(row);
    for (int begin = 0; begin < cols_;) {
      const int i = x.cell[begin];
      int end = begin + 1;
      while (end < cols_ && x.cell[end] == i) ++end;
      const auto constant = [&](int k) { return (1 - w) * gy0[k] * t + w * gy1[k] * (t - 1); };
      const auto slope = [&](int k) { return (1 - w) * gx0[k] + w * gx1[k]; };
      const float right = slope(i + 1);
      add_run(out + begin, &x.place[begin], &x.ease[begin], end - begin, constant(i), slope(i), constant(i + 1) - right,
              right);
      begin = end;
    }
  };
  if (rows_ * cols_ > 100'000) {  // below, threads cost more than they save
    parallel_for(rows_, add_row);
  } else {
    for (int row = 0; row < rows_; ++row) add_row(row);
  }
}

double CoherentNoise::bound() const {
  // A node with a unit gradient gives at most its distance d; the weighted mean of d is at most the root of that of
  // d^2, which is largest in the middle of the cell: 1/2.
  double sum = 0;
  for (const Lattice& lattice : lattices_) sum += lattice.scale * std::sqrt(0.5);
  return sum;
}

void CoherentNoise::draw(const RandomStream& stream, cv::Mat& field) const {
  field.create(rows_, cols_, CV_32F);
  field.setTo(0);
  for (std::size_t i = 0; i < lattices_.size(); ++i) add(lattices_[i], stream.child(i), field);
}

cv::Mat CoherentNoise::recent(const RandomStream& stream) const {
  std::uint64_t kind = mix_keys(hash_text("coherent noise"), std::bit_cast<std::uint64_t>(grid_px_));
  kind = mix_keys(mix_keys(kind, rows_), mix_keys(cols_, static_cast<std::uint64_t>(weight_)));
  return recent_field(kind, stream, [&](cv::Mat& field) { draw(stream, field); });
}

DisturbanceField::DisturbanceField(int rows, int cols, double grid_px, double changing, LatticeWeight weight,
                                   const RandomStream& capture_draws)
    : noise_(rows, cols, grid_px, weight), changing_(changing), capture_draws_(capture_draws) {}

double DisturbanceField::bound() const { return noise_.bound() * (std::sqrt(1 - changing_) + std::sqrt(changing_)); }

cv::Mat DisturbanceField::at(const RandomStream& frame_draws) const {
  const cv::Mat fixed = noise_.recent(capture_draws_.child("disturbance"));
  if (changing_ <= 0) return fixed;
  const cv::Mat fresh = noise_.recent(frame_draws.child("disturbance"));
  cv::Mat mixed;
  cv::addWeighted(fixed, std::sqrt(1 - changing_), fresh, std::sqrt(changing_), 0, mixed);
  return mixed;
}

}  // namespace binrig
