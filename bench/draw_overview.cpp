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

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 4) throw Error("usage: draw_overview DEMO PILE.jpg OUT.png");
  const std::string demo = argv[1];
  const cv::Mat pile = picture(argv[2]);
  const int third = (width - 2 * gap) / 3;
  std::vector<cv::Mat> views;
  // Its upper half is the view from above: colour, depth, instances.
  for (int i = 0; i < 3; ++i) {
    views.push_back(scaled(pile(cv::Rect(i * pile.cols / 3, 0, pile.cols / 3, pile.rows / 2)), third));
  }
  const std::vector<cv::Mat> rows{scaled(picture(demo + "/compare/test_1_residual.png"), width),
                                  row({scaled(picture(demo + "/compare/test_1_spectrum.png"), 380),
                                       scaled(picture(demo + "/improve/bias_1.png"), width - 380 - gap)}),
                                  row(views)};
  cv::Mat sheet;
  cv::vconcat(rows, sheet);
  if (!cv::imwrite(argv[3], sheet)) throw Error(std::string("cannot write ") + argv[3]);
} catch (const std::exception& problem) {
  std::fprintf(stderr, "draw_overview: %s\n", problem.what());
  return 2;
}
