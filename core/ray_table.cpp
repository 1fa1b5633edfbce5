#include "core/ray_table.h"

#include <functional>

#include "core/parallel.h"
#include "core/random.h"
#include "core/recently_made.h"

namespace binrig {

namespace {
constexpr std::size_t cached_tables = 12, cached_exact_tables = 4;  // 1280 x 960: 10 and 20 MB each

struct CameraHash {
  std::size_t operator()(const Camera& c) const {
    const std::hash<double> hash;
    return mix_keys(mix_keys(hash(c.fx), hash(c.fy)), mix_keys(hash(c.cx), hash(c.cy)));
  }
};

template <typename T>
cv::Mat make_table(const Camera& camera) {
  cv::Mat_<cv::Vec<T, 2>> table(camera.height, camera.width);
  if (!camera.distorted()) {
    for (int row = 0; row < camera.height; ++row) {
      const auto y = static_cast<T>((row - camera.cy) / camera.fy);
      for (int col = 0; col < camera.width; ++col) table(row, col) = {static_cast<T>((col - camera.cx) / camera.fx), y};
    }
    return table;
  }
  parallel_for(camera.height, [&](int row) {
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector3d ray = camera.ray(col, row);
      table(row, col) = {static_cast<T>(ray.x()), static_cast<T>(ray.y())};
    }
  });
  return table;
}
}  // namespace

cv::Mat ray_table(const Camera& camera) {
  static RecentlyMade<Camera, cv::Mat, CameraHash> tables(cached_tables);
  return tables.get(camera, [&] { return make_table<float>(camera); });
}

cv::Mat exact_ray_table(const Camera& camera) {
  static RecentlyMade<Camera, cv::Mat, CameraHash> tables(cached_exact_tables);
  return tables.get(camera, [&] { return make_table<double>(camera); });
}

}  // namespace binrig
