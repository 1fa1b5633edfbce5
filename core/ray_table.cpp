#include "core/ray_table.h"

#include <list>
#include <mutex>
#include <utility>

#include "core/parallel.h"

namespace binrig {

namespace {
constexpr std::size_t cached_tables = 12;  // 1280 x 960: 10 MB each

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
  static std::mutex mutex;
  static std::list<std::pair<Camera, cv::Mat>> tables;  // used last comes first
  {
    const std::lock_guard lock(mutex);
    for (auto it = tables.begin(); it != tables.end(); ++it) {
      if (it->first == camera) {
        tables.splice(tables.begin(), tables, it);
        return tables.front().second;
      }
    }
  }
  // Made outside the lock: two threads may make the same table, which costs time and nothing else.
  cv::Mat table = make_table(camera);
  const std::lock_guard lock(mutex);
  tables.emplace_front(camera, table);
  if (tables.size() > cached_tables) tables.pop_back();
  return table;
}

}  // namespace binrig
