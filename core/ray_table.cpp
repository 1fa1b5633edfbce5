#include "core/ray_table.h"

#include <functional>

#include "core/parallel.h"
#include "core/random.h"
#include "core/recently_made.h"

namespace binrig {

namespace {
constexpr std::size_t cached_tables = 12;  // 1280 x 960: 10 MB each

struct CameraHash {
  std::size_t operator()(const Camera& c) const {
    const std::hash<double> hash;
    return mix_keys(mix_keys(hash(c.fx), hash(c.fy)), mix_keys(hash(c.cx), hash(c.cy)));
  }
};

cv::Mat make_table(const Camera& camera) {
  cv::Mat table(camera.height, camera.width, CV_32FC2);
  if (!camera.distorted()) {
    for (int row = 0; row < camera.height; ++row) {
      auto* out = table.ptr<cv::Vec2f>(row);
      const auto y = static_cast<float>((row - camera.cy) / camera.fy);
      for (int col = 0; col < camera.width; ++col) {
        out[col] = {static_cast<float>((col - camera.cx) / camera.fx), y};
      }
    }
    return table;
  }
  parallel_for(camera.height, [&](int row) {
    auto* out = table.ptr<cv::Vec2f>(row);
    for (int col = 0; col < camera.width; ++col) {
      const Eigen::Vector3d ray = camera.ray(col, row);
      out[col] = {static_cast<float>(ray.x()), static_cast<float>(ray.y())};
    }
  });
  return table;
}
}  // namespace

cv::Mat ray_table(const Camera& camera) {
  static RecentlyMade<Camera, cv::Mat, CameraHash> tables(cached_tables);
  return tables.get(camera, [&] { return make_table(camera); });
}

}  // namespace binrig
