// draw_overview DEMO PILE.jpg OUT.png: the first picture of README from what `./rig demo` wrote into DEMO and a picture
// of draw_piles: real and simulated departure from a plane; their spectra and the error before and after `improve`; a
// pile.
#include <algorithm>
#include <cstdio>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace {

using namespace binrig;

constexpr int width = 1000, gap = 12;

cv::Mat picture(const std::string& file) {
  cv::Mat image = cv::imread(file, cv::IMREAD_COLOR);
  if (image.empty()) throw Error("cannot read " + file);
  return image;
}

cv::Mat scaled(const cv::Mat& image, int columns) {
  cv::Mat out;
  cv::resize(image, out, {columns, image.rows * columns / image.cols}, 0, 0,
             columns < image.cols ? cv::INTER_AREA : cv::INTER_CUBIC);
  return out;
}

// Side by side, centred in height, on white.
cv::Mat row(const std::vector<cv::Mat>& panels) {
  int rows = 0;
  for (const cv::Mat& panel : panels) rows = std::max(rows, panel.rows);
  cv::Mat out(rows, width, CV_8UC3, cv::Scalar::all(255));
  int col = 0;
  for (const cv::Mat& panel : panels) {
    panel.copyTo(out(cv::Rect(col, (rows - panel.rows) / 2, panel.cols, panel.rows)));
    col += panel.cols + gap;
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 5) throw Error("usage: draw_overview DEMO CAPTURE PILE.jpg OUT.png");
  const std::string demo = argv[1];
  const std::string capture = demo + "/compare/" + argv[2];
  const cv::Mat pile = picture(argv[3]);
  const int third = (width - 2 * gap) / 3;
  std::vector<cv::Mat> views;
  // Its upper half is the view from above: colour, depth, instances.
  for (int i = 0; i < 3; ++i) {
    views.push_back(scaled(pile(cv::Rect(i * pile.cols / 3, 0, pile.cols / 3, pile.rows / 2)), third));
  }
  const std::vector<cv::Mat> rows{scaled(picture(capture + "_residual.png"), width),
                                  row({scaled(picture(capture + "_spectrum.png"), 380),
                                       scaled(picture(demo + "/improve/bias_1.png"), width - 380 - gap)}),
                                  row(views)};
  cv::Mat sheet;
  cv::vconcat(rows, sheet);
  if (!cv::imwrite(argv[4], sheet, {cv::IMWRITE_PNG_COMPRESSION, 9}))
    throw Error(std::string("cannot write ") + argv[4]);
} catch (const std::exception& problem) {
  std::fprintf(stderr, "draw_overview: %s\n", problem.what());
  return 2;
}
