// Point clouds side by side, turned together: dragged on the page, as a still picture beside it.
#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "report/colours.h"

namespace binrig {

struct CloudPanel {
  std::string title;
  std::vector<Eigen::Vector3f> points;  ///< mm, x right, y down, z away from the viewer
  std::vector<float> values;            ///< one a point, for its colour
};

struct CloudFigure {
  std::string name, alt, caption;
  std::string unit;  ///< of the values
  std::vector<CloudPanel> panels;
  double low = 0, high = 0;  ///< scale of the values, low < high
  ColourScale colours = ColourScale::diverging;
  /// First view: turned about the vertical, then about the horizontal axis of the picture.
  double yaw_rad = 0.5, pitch_rad = -0.9;
};

/// A cloud reduced to what is embedded: at most 40,000 points a panel (evenly thinned out), coordinates as 16-bit
/// shares of a box common to all panels, values as places on the colour scale.
struct PackedCloud {
  std::vector<std::int16_t> xyz;
  std::vector<std::uint8_t> colour;
};
/// Throws Error: no panel, points and values differ in number, low >= high, a coordinate that is not finite.
std::vector<PackedCloud> pack(const CloudFigure& figure);

/// The first view of all panels side by side, as the page draws it (RGB).
cv::Mat compose(const CloudFigure& figure);

}  // namespace binrig
