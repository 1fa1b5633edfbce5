#include "diagnose/spot.h"

#include <algorithm>
#include <cmath>

namespace binrig {
namespace {

/// Mean square of train captures by cell, in standard deviations of chance.
std::vector<double> squares_of(const Layout& layout, const Whitened& rest, int segment, int cells) {
  std::vector<double> squares(cells, 0), known(cells, 0);
  for (const Block& block : layout.blocks)
    if (block.segment == segment && block.train && block.size == cells)
      for (int i = 0; i < cells; ++i)
        if (const double y = rest[block.offset + i]; y != 0) squares[i] += y * y, known[i] += 1;
  for (int i = 0; i < cells; ++i)
    squares[i] = known[i] > 0 ? std::max(0.0, squares[i] - known[i]) / std::sqrt(2 * known[i]) : 0;
  return squares;
}

}  // namespace

std::optional<Spot> spot_left(const Experiment& experiment, const Whitened& rest) {
  const Layout& layout = experiment.layout();
  std::optional<Spot> most;
  std::vector<bool> seen(segments().size(), false);
  for (const Block& block : layout.blocks) {
    if (block.rows == 1 || !block.train || seen[block.segment]) continue;
    seen[block.segment] = true;
    const auto squares = squares_of(layout, rest, block.segment, block.size);
    const int at = static_cast<int>(std::max_element(squares.begin(), squares.end()) - squares.begin());
    std::vector<double> sorted = squares;
    const auto ninth = sorted.begin() + static_cast<long>(0.9 * static_cast<double>(sorted.size()));
    std::nth_element(sorted.begin(), ninth, sorted.end());
    const double stands_out = squares[at] / (1 + *ninth);
    if (most && stands_out <= most->stands_out) continue;
    const Camera& camera = experiment.context(block.capture).camera;
    const ImageCoordinates coordinates(camera);
    const int side = (camera.width + block.cols - 1) / block.cols;
    most = {coordinates.x((at % block.cols + 0.5) * side - 0.5), coordinates.y((at / block.cols + 0.5) * side - 0.5),
            coordinates.scale * side, stands_out};
  }
  return most;
}

}  // namespace binrig
