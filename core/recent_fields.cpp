#include "core/recent_fields.h"

#include "core/recently_made.h"

namespace binrig {

cv::Mat recent_field(std::uint64_t kind, const RandomStream& draws, const std::function<void(cv::Mat& field)>& draw) {
  constexpr std::size_t kept_bytes = 128 << 20;  // 107 fields of 640 x 480
  static RecentlyMade<std::uint64_t, cv::Mat> recent(
      kept_bytes, [](const cv::Mat& field) { return field.total() * field.elemSize(); });
  return recent.get(mix_keys(kind, draws.key()), [&] {
    cv::Mat field;
    draw(field);
    return field;
  });
}

}  // namespace binrig
