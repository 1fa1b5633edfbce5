#include "tests/support/recordings.h"

#include <unistd.h>

#include <cstdlib>

#include <opencv2/core.hpp>

namespace binrig::test {

namespace fs = std::filesystem;

std::string shared_recording(const std::string& name) {
  const char* given = std::getenv("BINRIG_RECORDINGS");
  const fs::path root = given ? fs::path(given) : fs::path(BINRIG_SOURCE_DIR).parent_path() / "shared" / "recordings";
  return fs::is_directory(root / name) ? (root / name).string() : "";
}

ScratchFolder::ScratchFolder() {
  std::string pattern = (fs::temp_directory_path() / "binrig-test-XXXXXX").string();
  if (!::mkdtemp(pattern.data())) std::abort();
  path_ = pattern;
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

Frame full_frame(int number) {
  Frame frame;
  frame.camera.width = 24;
  frame.camera.height = 16;
  frame.camera.fx = 50.25;
  frame.camera.fy = 50.5;
  frame.camera.cx = 11.7;
  frame.camera.cy = 7.4;
  frame.camera.distortion = {0.01, -0.002, 1e-4, -2e-4, 0.003, 0, 0, 0};
  frame.depth_scale_mm = 0.1;
  frame.depth_mm.create(16, 24, CV_32F);
  frame.reason = cv::Mat::zeros(16, 24, CV_8U);
  frame.ir.create(16, 24, CV_16U);
  frame.rgb.create(16, 24, CV_8UC3);
  frame.ids = cv::Mat::zeros(16, 24, CV_16U);
  for (int row = 0; row < 16; ++row) {
    for (int col = 0; col < 24; ++col) {
      const int step = 7000 + 13 * row + 5 * col + number;
      frame.depth_mm.at<float>(row, col) = static_cast<float>(step * frame.depth_scale_mm);
      frame.ir.at<std::uint16_t>(row, col) = static_cast<std::uint16_t>(1000 * row + col + number);
      frame.rgb.at<cv::Vec3b>(row, col) = cv::Vec3b(10 * row, 5 * col, 200 - row);
      if (row > 3 && row < 9) frame.ids.at<std::uint16_t>(row, col) = col < 12 ? 1 : 2;
      if ((row * 24 + col) % 17 == 0) invalidate(frame, row, col, static_cast<Reason>(1 + (row + col) % 12));
    }
  }
  Pose X_CO = Pose::Identity();
  X_CO.rotate(Eigen::AngleAxisd(0.3 + 0.01 * number, Vector3(1, 2, 3).normalized()));
  X_CO.translation() = Vector3(1.25, -7.5, 710.123456789);
  frame.objects = {{3, X_CO}, {12, X_CO.inverse()}};
  frame.X_WC = X_CO * X_CO;
  frame.time_s = number / 3.0;
  frame.host_time_s = 1.7e9 + number;
  frame.sequence = 40 + number;
  return frame;
}

}  // namespace binrig::test
