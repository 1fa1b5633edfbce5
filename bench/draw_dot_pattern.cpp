// Draws docs/pictures/dot-pattern-kinect.png: a frame of a real structured-light camera beside the same boxes seen by
// the first-principles instrument.
//
//   draw_dot_pattern SET CAPTURE MODEL OUT.png [LEFT TOP WIDTH HEIGHT]
#include <cstdio>
#include <cstdlib>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "app/forward.h"
#include "core/recording_set.h"
#include "report/colours.h"
#include "report/map.h"
#include "sim/effect.h"

namespace {

using namespace binrig;

cv::Mat titled(const cv::Mat& picture, const std::string& title) {
  cv::Mat out(picture.rows + 26, picture.cols, CV_8UC3, cv::Scalar(255, 255, 255));
  picture.copyTo(out(cv::Rect(0, 26, picture.cols, picture.rows)));
  cv::putText(out, title, {4, 18}, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar(40, 40, 40), 1, cv::LINE_AA);
  return out;
}

cv::Mat depth_picture(const Frame& frame, cv::Rect part, double low, double high) {
  MapPanel panel;
  panel.values = frame.depth_mm(part).clone();
  panel.valid = panel.values > 0;
  return colour_panel(panel, low, high, ColourScale::sequential).rgb();
}

// Steps and ripples: what is left of the depth after a Gaussian of 6 px that skips holes.
cv::Mat detail_picture(const Frame& frame, cv::Rect part) {
  cv::Mat valid, depth = frame.depth_mm(part).clone(), smooth, weight;
  cv::Mat(depth > 0).convertTo(valid, CV_32F, 1.0 / 255);
  cv::GaussianBlur(depth, smooth, {}, 6);
  cv::GaussianBlur(valid, weight, {}, 6);
  MapPanel panel;
  panel.values = depth - smooth / cv::max(weight, 1e-3f);
  panel.valid = depth > 0;
  return colour_panel(panel, -5, 5, ColourScale::diverging).rgb();
}

int draw(int argc, char** argv) {
  const std::string set_path = argv[1], capture = argv[2];
  const RecordingSet set = RecordingSet::open(set_path);
  const Frame measured = set.capture(capture).frame(0);
  ForwardOptions options;
  options.captures = {capture};
  const Forward forward = open_forward_model(set_path, options);
  const SensorModel model = read_sensor_model(argv[3], effect_catalogue());
  Frame simulated;
  SimulationRequest request;
  request.model = &model;
  forward.model->simulate(request, [&](const Frame& frame, int) { simulated = frame; });

  cv::Rect part(0, 0, measured.depth_mm.cols, measured.depth_mm.rows);
  if (argc == 9) part = cv::Rect(std::atoi(argv[5]), std::atoi(argv[6]), std::atoi(argv[7]), std::atoi(argv[8]));
  double low = 0, high = 0;
  cv::minMaxLoc(measured.depth_mm(part), &low, &high, nullptr, nullptr, measured.depth_mm(part) > 0);
  cv::Mat upper, lower, all;
  cv::hconcat(titled(depth_picture(measured, part, low, high), "measured (" + set.info().sensor.name + ")"),
              titled(depth_picture(simulated, part, low, high), "first-principles instrument"), upper);
  cv::hconcat(titled(detail_picture(measured, part), "measured, departure from its surroundings -5 .. 5 mm"),
              titled(detail_picture(simulated, part), "instrument, the same"), lower);
  cv::vconcat(upper, lower, all);
  cv::cvtColor(all, all, cv::COLOR_RGB2BGR);
  cv::imwrite(argv[4], all);
  for (const auto& [name, frame] : {std::pair{"measured", &measured}, {"instrument", &simulated}}) {
    std::printf("%s: %d pixels with depth\n", name, cv::countNonZero(frame->depth_mm));
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5 && argc != 9) {
    std::fprintf(stderr, "usage: draw_dot_pattern SET CAPTURE MODEL OUT.png [LEFT TOP WIDTH HEIGHT]\n");
    return 2;
  }
  try {
    return draw(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
}
