// draw_five_effects WORLD.yaml OUT.png: the thesis's five effects one after the other (its Figure 5-19) on one frame of a
// world. Each panel adds one effect to the panel before it; depth is shaded, a missing pixel has the colour of its reason.
#include <cstdio>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "report/colours.h"
#include "sim/effect.h"
#include "sim/synthetic_source.h"

namespace {

using namespace binrig;

// Depth as a surface under a lamp from the upper left: noise and steps show, as they would in a viewer of point clouds.
cv::Mat shaded(const Frame& frame) {
  cv::Mat picture(frame.depth_mm.size(), CV_8UC3);
  const double pixel_mm = 800 / frame.camera.fx;
  for (int row = 0; row < picture.rows; ++row) {
    for (int col = 0; col < picture.cols; ++col) {
      const auto reason = static_cast<Reason>(frame.reason.at<std::uint8_t>(row, col));
      auto& pixel = picture.at<cv::Vec3b>(row, col);
      if (reason != Reason::measured) {
        const Rgb colour = reason_categories()[static_cast<std::size_t>(reason)].colour;
        pixel = cv::Vec3b(colour[2], colour[1], colour[0]);
        continue;
      }
      const int left = std::max(0, col - 1), up = std::max(0, row - 1);
      const float z = frame.depth_mm.at<float>(row, col), x = frame.depth_mm.at<float>(row, left), y = frame.depth_mm.at<float>(up, col);
      const Vector3 normal = Vector3(x > 0 ? (z - x) / pixel_mm : 0, y > 0 ? (z - y) / pixel_mm : 0, -1).normalized();
      const double light = std::max(0.0, normal.dot(Vector3(-0.4, -0.5, -0.77)));
      pixel = cv::Vec3b::all(cv::saturate_cast<std::uint8_t>(40 + 200 * light));
    }
  }
  return picture;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 3) throw Error("usage: draw_five_effects WORLD.yaml OUT.png");
  const std::vector<std::pair<std::string, std::map<std::string, double>>> steps{
      {"", {}},
      {"projector_shadow", {{"bias", 1}}},
      {"specular_saturation", {{"threshold", 0.6}}},
      {"low_confidence", {{"threshold", 75}}},
      {"spectral_noise", {{"sigma", 0.25}, {"correlation_length", 1.2}, {"white_share", 0.1}}},
      {"bilateral_blur", {{"sigma_px", 1}}}};
  SensorModel model = parse_sensor_model(
      "name: five\ncamera: {width: 1280, height: 960, horizontal_fov_deg: 16.06}\nprojector: {x: 100}\n"
      "reference_distance: 800\ndepth_scale: 0.02\nframe_rate_hz: 3\n",
      "five", effect_catalogue());
  const WorldProvider world = world_in_motion(read_world(argv[1]), 1);
  std::vector<cv::Mat> panels;
  for (const auto& [effect, values] : steps) {
    if (!effect.empty()) add_effect(model, effect_catalogue(), effect, values);
    SyntheticCamera camera(world, model);
    camera.begin_scene(0, 1);
    const cv::Mat picture = shaded(camera.frame());
    const cv::Rect middle(picture.cols / 2 - 320, picture.rows / 2 - 240, 640, 480);
    cv::Mat panel;
    cv::copyMakeBorder(picture(middle), panel, 34, 6, 3, 3, cv::BORDER_CONSTANT | cv::BORDER_ISOLATED, cv::Scalar::all(255));
    cv::putText(panel, effect.empty() ? "perfect depth" : "+ " + effect, {8, 24}, cv::FONT_HERSHEY_SIMPLEX, 0.7,
                cv::Scalar::all(30), 1, cv::LINE_AA);
    panels.push_back(panel);
  }
  cv::Mat top, bottom, sheet;
  cv::hconcat(std::vector<cv::Mat>(panels.begin(), panels.begin() + 3), top);
  cv::hconcat(std::vector<cv::Mat>(panels.begin() + 3, panels.end()), bottom);
  cv::vconcat(top, bottom, sheet);
  if (!cv::imwrite(argv[2], sheet)) throw Error(std::string("cannot write ") + argv[2]);
} catch (const std::exception& problem) {
  std::fprintf(stderr, "draw_five_effects: %s\n", problem.what());
  return 2;
}
