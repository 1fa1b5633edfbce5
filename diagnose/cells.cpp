#include "diagnose/cells.h"

#include <algorithm>
#include <cmath>

#include <opencv2/core.hpp>

namespace binrig {

const std::vector<Covariate>& covariates() {
  static const std::vector<Covariate> all{
      {"z", "z", "distance (mm)"},
      {"x", "x", "x in the image (half widths from its centre)"},
      {"y", "y", "y in the image (half widths from its centre)"},
      {"r2", "r2", "squared radius in the image (half widths)"},
      {"theta", "theta", "incidence angle (deg)", 180 / 3.14159265358979323846},
      {"I", "I", "ln of the infra-red intensity"},
      {"distance to edge", "e", "distance to a depth edge (px)"},
      {"disparity phase", "", "fraction of the disparity (px)"},
  };
  return all;
}

std::vector<MapCell> cells_of(const Experiment& experiment, const Rung& rung, const StatVector& data,
                              const std::string& segment) {
  const Whitened& rest = rung.rest;
  std::vector<MapCell> cells;
  for (const auto& block : experiment.layout().blocks) {
    if (segments()[block.segment].name != segment || block.rows == 1) continue;
    const StatisticContext& context = experiment.context(block.capture);
    const Channels& nominal = experiment.nominal(block.capture);
    const auto light =
        experiment.forward().perfect(block.capture, 0, Offset{}, Channel::depth | Channel::diffuse, rung.model);
    const ImageCoordinates at(context.camera);
    const int side = (context.camera.width + block.cols - 1) / block.cols;
    for (int i = 0; i < block.size; ++i) {
      const int k = block.offset + i;
      if (rung.standard.spread()[k] == 0 || std::isnan(data[k])) continue;
      const int u = std::min(context.camera.width - 1, (i % block.cols) * side + side / 2);
      const int v = std::min(context.camera.height - 1, (i / block.cols) * side + side / 2);
      const double z = nominal.depth_mm.at<float>(v, u);
      if (z <= 0) continue;
      const double intensity =
          light->diffuse.empty() ? 0.4 : std::max(0.01, static_cast<double>(light->diffuse.at<float>(v, u)));
      const double disparity = context.focal_baseline / z;
      cells.push_back(
          {k,
           block.train,
           rest[k],
           data[k] - rung.standard.mean()[k],
           at.x(u),
           at.y(v),
           {z, at.x(u), at.y(v), at.r2(u, v),
            std::acos(std::min(1.0, static_cast<double>(nominal.cos_incidence.at<float>(v, u)))), std::log(intensity),
            static_cast<double>(nominal.edge_px.at<float>(v, u)), disparity - std::floor(disparity)}});
    }
  }
  return cells;
}

}  // namespace binrig
