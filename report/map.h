// Colour maps of images: values on a common scale, and kinds of pixels in fixed colours.
#pragma once

#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "report/colours.h"

namespace binrig {

/// One image of a figure.
struct MapPanel {
  std::string title;  ///< "measured", "simulated"
  cv::Mat values;     ///< CV_32F
  cv::Mat valid;      ///< CV_8U, 0 = no value there; empty = values that are finite
};

/// Images side by side on one colour scale. On the page the reader sees the values under the pointer, of all panels at
/// once; two panels of one size can be laid over each other and wiped.
struct MapFigure {
  std::string name, alt, caption;
  std::string unit;
  std::vector<MapPanel> panels;
  /// Ends of the scale; both 0: chosen over all panels together, from the 1 % to the 99 % quantile, symmetric about
  /// zero for the diverging scale. Values beyond the ends get the end's colour.
  double low = 0, high = 0;
  ColourScale colours = ColourScale::sequential;
  cv::Point origin;  ///< pixel of the full image at the panels' top left corner; for the read-out
};

/// Images of kinds (labels 0 .. categories-1, CV_8U) in fixed colours with a legend of those that occur.
struct CategoryPanel {
  std::string title;
  cv::Mat labels;
};
struct CategoryFigure {
  std::string name, alt, caption;
  std::vector<CategoryPanel> panels;
  std::vector<Category> categories;
  cv::Point origin;
};

/// A panel as it is embedded: colours by index, at most 720 px a side (every `step`-th pixel is kept, none is averaged,
/// so that noise keeps its look).
struct PanelImage {
  cv::Mat index;  ///< CV_8U
  std::vector<Rgb> palette;
  int step = 1;
  cv::Mat rgb() const;
};
PanelImage colour_panel(const MapPanel& panel, double low, double high, ColourScale colours);
PanelImage colour_panel(const CategoryPanel& panel, const std::vector<Category>& categories);

/// The scale's ends for a figure: its own, or chosen as described there. Throws Error if a panel is not CV_32F, sizes
/// of values and valid differ, or low >= high was asked for.
void choose_scale(MapFigure& figure);

/// The whole figure with titles and colour bar or legend as one picture (RGB), for the PNG beside the page.
cv::Mat compose(const MapFigure& figure);
cv::Mat compose(const CategoryFigure& figure);

/// Round numbers that divide low .. high into 4 to 8 parts.
std::vector<double> round_ticks(double low, double high);

}  // namespace binrig
