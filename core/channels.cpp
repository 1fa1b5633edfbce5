#include "core/channels.h"

#include <cmath>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/parallel.h"
#include "core/ray_table.h"

namespace binrig {

namespace {
constexpr float edge_step_mm = 8.f;
constexpr float crease_cosine = 0.9f;
constexpr float crease_step_mm = 6.f;
constexpr float farthest_px = 64.f;
constexpr int band_rows = 16;

float dot(const cv::Vec3f& n, float x, float y) { return n[0] * x + n[1] * y + n[2]; }

struct Images {
  const cv::Mat& depth;
  const cv::Mat& normal;
  const cv::Mat& rays;
  bool edges, creases;
};

bool is_edge(float z_p, float z_q, const cv::Vec3f& n_p, const cv::Vec3f& n_q, const cv::Vec2f& r_p,
             const cv::Vec2f& r_q) {
  if (z_p <= 0.f || z_q <= 0.f) return (z_p > 0.f) != (z_q > 0.f);  // a surface that ends before nothing
  if (std::abs(z_p - z_q) <= edge_step_mm) return false;
  // The plane through P predicts z = (n_p . P) / (n_p . r_q) at q; multiplied out, so that a plane along the ray is no
  // division by zero. One of the two surfaces explaining the step is enough: the top of a steep wall is no edge.
  const float across_p = dot(n_p, r_q[0], r_q[1]), across_q = dot(n_q, r_p[0], r_p[1]);
  const float miss_p = std::abs(z_q * across_p - z_p * dot(n_p, r_p[0], r_p[1]));
  const float miss_q = std::abs(z_p * across_q - z_q * dot(n_q, r_q[0], r_q[1]));
  return miss_p > edge_step_mm * std::abs(across_p) && miss_q > edge_step_mm * std::abs(across_q);
}

bool is_crease(float z_p, float z_q, const cv::Vec3f& n_p, const cv::Vec3f& n_q, const cv::Vec2f& r_p,
               const cv::Vec2f& r_q) {
  if (z_p <= 0.f || z_q <= 0.f || n_p.dot(n_q) >= crease_cosine || std::abs(z_p - z_q) >= crease_step_mm) return false;
  // Folded towards the camera: each point lies on the side of the other's surface that the normal points to.
  const cv::Vec3f from_p_to_q(z_q * r_q[0] - z_p * r_p[0], z_q * r_q[1] - z_p * r_p[1], z_q - z_p);
  return from_p_to_q.dot(n_p) > 0.f && from_p_to_q.dot(n_q) < 0.f;
}

// Marks with 0 the pixels of every pair (row, row + below) x (left, right) that is an edge or a crease. Rows are worked
// on in parallel, so each row looks at all four of its neighbours and marks itself alone.
void mark_row(const Images& in, int row, cv::Mat& edge, cv::Mat& crease) {
  const int rows = in.depth.rows, cols = in.depth.cols;
  const auto* z = in.depth.ptr<float>(row);
  const auto* n = in.normal.ptr<cv::Vec3f>(row);
  const auto* r = in.rays.ptr<cv::Vec2f>(row);
  auto* edge_row = in.edges ? edge.ptr<uchar>(row) : nullptr;
  auto* crease_row = in.creases ? crease.ptr<uchar>(row) : nullptr;
  for (int col = 0; col + 1 < cols; ++col) {
    if (edge_row && is_edge(z[col], z[col + 1], n[col], n[col + 1], r[col], r[col + 1])) {
      edge_row[col] = edge_row[col + 1] = 0;
    }
    if (crease_row && is_crease(z[col], z[col + 1], n[col], n[col + 1], r[col], r[col + 1])) {
      crease_row[col] = crease_row[col + 1] = 0;
    }
  }
  for (int other : {row - 1, row + 1}) {
    if (other < 0 || other >= rows) continue;
    const auto* z_other = in.depth.ptr<float>(other);
    const auto* n_other = in.normal.ptr<cv::Vec3f>(other);
    const auto* r_other = in.rays.ptr<cv::Vec2f>(other);
    for (int col = 0; col < cols; ++col) {
      if (edge_row && is_edge(z[col], z_other[col], n[col], n_other[col], r[col], r_other[col])) edge_row[col] = 0;
      if (crease_row && is_crease(z[col], z_other[col], n[col], n_other[col], r[col], r_other[col])) {
        crease_row[col] = 0;
      }
    }
  }
}

cv::Mat distance_to_zero(const cv::Mat& mask) {
  cv::Mat distance;
  // The exact Euclidean transform of Felzenszwalb and Huttenlocher (2012).
  cv::distanceTransform(mask, distance, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  for (int row = 0; row < distance.rows; ++row) {
    auto* d = distance.ptr<float>(row);
    for (int col = 0; col < distance.cols; ++col) d[col] = std::min(d[col] + 0.5f, farthest_px);
  }
  return distance;
}
}  // namespace

ChannelSet Channels::present() const {
  ChannelSet set = 0;
  const auto add = [&](const cv::Mat& image, Channel channel) {
    if (!image.empty()) set = set | channel;
  };
  add(depth_mm, Channel::depth);
  add(normal, Channel::normal);
  add(cos_incidence, Channel::cos_incidence);
  add(instance, Channel::instance);
  add(projector_gap_mm, Channel::projector_gap);
  add(diffuse, Channel::diffuse);
  add(specular, Channel::specular);
  add(ir, Channel::ir);
  add(edge_px, Channel::edge_distance);
  add(crease_px, Channel::crease_distance);
  add(rgb, Channel::rgb);
  return set;
}

void add_edge_channels(Channels& channels, ChannelSet wanted) {
  const bool edges = contains(wanted, Channel::edge_distance), creases = contains(wanted, Channel::crease_distance);
  if (!edges && !creases) return;
  const cv::Size size = channels.depth_mm.size();
  const cv::Mat rays = ray_table(channels.camera);
  const Images in{channels.depth_mm, channels.normal, rays, edges, creases};
  cv::Mat edge, crease;
  if (edges) edge = cv::Mat(size, CV_8U, cv::Scalar(1));
  if (creases) crease = cv::Mat(size, CV_8U, cv::Scalar(1));
  const int bands = (size.height + band_rows - 1) / band_rows;
  parallel_for(bands, [&](int band) {
    const int end = std::min(size.height, (band + 1) * band_rows);
    for (int row = band * band_rows; row < end; ++row) mark_row(in, row, edge, crease);
  });
  if (edges) channels.edge_px = distance_to_zero(edge);
  if (creases) channels.crease_px = distance_to_zero(crease);
}

}  // namespace binrig
