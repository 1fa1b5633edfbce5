#include "core/frame.h"

#include <cmath>
#include <cstring>

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/frame_source.h"

namespace binrig {
namespace {

constexpr const char* reason_names[reason_count] = {"measured",     "no_surface", "shadow",   "second_shadow", "saturated",
                                                    "low_confidence", "low_signal", "out_of_range", "no_match",
                                                    "defect",       "border",     "dropped",  "unknown"};
constexpr const char* status_names[] = {"complete", "incomplete", "timeout", "device_lost"};

std::string type_text(int type) { return cv::typeToString(type); }

bool close(double a, double b) {
  return std::abs(a - b) <= 1e-9 * std::max({1.0, std::abs(a), std::abs(b)});
}

std::string optional_difference(const char* what, const std::optional<double>& a, const std::optional<double>& b) {
  if (a.has_value() != b.has_value()) return fmt::format("{} is present in one frame only", what);
  if (a && !close(*a, *b)) return fmt::format("{}: {} against {}", what, *a, *b);
  return "";
}

std::string pose_difference(const std::string& what, const Pose& a, const Pose& b) {
  const double off = (a.matrix() - b.matrix()).cwiseAbs().maxCoeff();
  const double scale = std::max(1.0, a.translation().cwiseAbs().maxCoeff());
  return off <= 1e-9 * scale ? "" : fmt::format("{} differs by up to {}", what, off);
}

std::string pixel_text(const cv::Mat& image, int row, int col) {
  switch (image.type()) {
    case CV_32F: return fmt::format("{}", image.at<float>(row, col));
    case CV_16U: return fmt::format("{}", image.at<std::uint16_t>(row, col));
    case CV_8U: return fmt::format("{}", image.at<std::uint8_t>(row, col));
    default: return "another value";
  }
}

std::string image_difference(const char* what, const cv::Mat& a, const cv::Mat& b) {
  if (a.empty() && b.empty()) return "";
  if (a.empty() || b.empty()) return fmt::format("{} is present in one frame only", what);
  if (a.type() != b.type() || a.size() != b.size()) {
    return fmt::format("{}: {}x{} {} against {}x{} {}", what, a.cols, a.rows, type_text(a.type()), b.cols, b.rows,
                       type_text(b.type()));
  }
  const std::size_t pixel = a.elemSize();
  for (int row = 0; row < a.rows; ++row) {
    if (std::memcmp(a.ptr(row), b.ptr(row), pixel * a.cols) == 0) continue;
    for (int col = 0; col < a.cols; ++col) {
      if (std::memcmp(a.ptr(row) + col * pixel, b.ptr(row) + col * pixel, pixel) != 0) {
        return fmt::format("{} at ({}, {}): {} against {}", what, col, row, pixel_text(a, row, col),
                           pixel_text(b, row, col));
      }
    }
  }
  return "";
}

}  // namespace

const char* reason_name(Reason reason) { return reason_names[static_cast<int>(reason)]; }

std::optional<Reason> reason_from_name(const std::string& name) {
  for (int i = 0; i < reason_count; ++i) {
    if (name == reason_names[i]) return static_cast<Reason>(i);
  }
  return std::nullopt;
}

const char* status_name(FrameStatus status) { return status_names[static_cast<int>(status)]; }

std::optional<FrameStatus> status_from_name(const std::string& name) {
  for (int i = 0; i < 4; ++i) {
    if (name == status_names[i]) return static_cast<FrameStatus>(i);
  }
  return std::nullopt;
}

void Frame::check(const std::string& where) const {
  const bool without_images = depth_mm.empty() && (status == FrameStatus::timeout || status == FrameStatus::device_lost);
  if (without_images) return;
  Violations violations;
  auto image = [&](const char* key, const cv::Mat& mat, std::initializer_list<int> types, bool required) {
    if (mat.empty()) {
      if (required) violations.add(where, key, "is missing");
      return;
    }
    if (mat.cols != camera.width || mat.rows != camera.height) {
      violations.add({where, key, fmt::format("{} x {}", mat.cols, mat.rows), "px",
                      fmt::format("{} x {}", camera.width, camera.height), "differs from the camera's size"});
    }
    for (int type : types) {
      if (mat.type() == type) return;
    }
    violations.add({where, key, type_text(mat.type()), "", type_text(*types.begin()), "has the wrong type"});
  };
  const bool has_depth = !depth_mm.empty() || ir.empty();  // an infra-red camera alone is a frame, too
  image("depth_mm", depth_mm, {CV_32F}, has_depth);
  image("reason", reason, {CV_8U}, has_depth);
  image("ir", ir, {CV_16U, CV_8U}, false);
  image("rgb", rgb, {CV_8UC3}, false);
  image("ids", ids, {CV_16U}, false);
  if (missing_share < 0 || missing_share > 1) {
    violations.add({where, "missing_share", number_text(missing_share), "", "0 .. 1", ""});
  }
  violations.throw_if_any("a frame is malformed");
  for (int row = 0; row < depth_mm.rows; ++row) {
    const float* z = depth_mm.ptr<float>(row);
    const std::uint8_t* why = reason.ptr<std::uint8_t>(row);
    for (int col = 0; col < depth_mm.cols; ++col) {
      if (std::isfinite(z[col]) && z[col] >= 0 && (z[col] > 0) == (why[col] == 0) && why[col] < reason_count) continue;
      throw Error("a frame is malformed",
                  {{where, fmt::format("depth_mm at ({}, {})", col, row), number_text(z[col]), "mm", "",
                    why[col] < reason_count ? fmt::format("contradicts its reason '{}'", reason_names[why[col]])
                                            : fmt::format("has the unknown reason {}", why[col])}});
    }
  }
}

std::string difference(const Frame& a, const Frame& b) {
  std::string text;
  auto first = [&](std::string found) {
    if (text.empty()) text = std::move(found);
  };
  first(image_difference("depth", a.depth_mm, b.depth_mm));
  first(image_difference("reason", a.reason, b.reason));
  first(image_difference("IR", a.ir, b.ir));
  first(image_difference("RGB", a.rgb, b.rgb));
  first(image_difference("ids", a.ids, b.ids));
  if (a.camera.width != b.camera.width || a.camera.height != b.camera.height) first("image size differs");
  for (auto [name, x, y] : {std::tuple{"fx", a.camera.fx, b.camera.fx}, {"fy", a.camera.fy, b.camera.fy},
                            {"cx", a.camera.cx, b.camera.cx}, {"cy", a.camera.cy, b.camera.cy},
                            {"depth scale", a.depth_scale_mm, b.depth_scale_mm},
                            {"missing share", a.missing_share, b.missing_share}}) {
    if (!close(x, y)) first(fmt::format("{}: {} against {}", name, x, y));
  }
  for (std::size_t i = 0; i < a.camera.distortion.size(); ++i) {
    if (!close(a.camera.distortion[i], b.camera.distortion[i])) first("lens distortion differs");
  }
  if (a.X_WC.has_value() != b.X_WC.has_value()) first("camera pose is present in one frame only");
  if (a.X_WC && b.X_WC) first(pose_difference("camera pose", *a.X_WC, *b.X_WC));
  if (a.objects.has_value() != b.objects.has_value()) first("object poses are present in one frame only");
  if (a.objects && b.objects) {
    if (a.objects->size() != b.objects->size()) first("number of objects differs");
    for (std::size_t i = 0; i < std::min(a.objects->size(), b.objects->size()); ++i) {
      const ObjectPose &p = (*a.objects)[i], &q = (*b.objects)[i];
      if (p.obj_id != q.obj_id) first(fmt::format("object {} has another id", i));
      first(pose_difference(fmt::format("pose of object {}", i), p.X_CO, q.X_CO));
    }
  }
  first(optional_difference("device time", a.time_s, b.time_s));
  first(optional_difference("host time", a.host_time_s, b.host_time_s));
  if (a.sequence != b.sequence) first(fmt::format("sequence number: {} against {}", a.sequence, b.sequence));
  if (a.status != b.status) first("status differs");
  return text;
}

std::optional<Vector3> SensorInfo::projector() const {
  if (projector_xyz_mm) return projector_xyz_mm;
  if (baseline_mm) return Vector3(*baseline_mm, 0, 0);
  return std::nullopt;
}

}  // namespace binrig
