// Drop-out: share of invalid pixels in cells.
#include <cmath>

#include "compare/statistic.h"
#include "compare/statistics/grid.h"

namespace binrig {
namespace {

class Dropout : public Statistic {
 public:
  explicit Dropout(const StatisticContext& context)
      : grid_(context, context.cell_px()), missing_(grid_.size()), count_(grid_.size()) {}

  void add(const ObservedFrame& observed) override {
    const cv::Mat& counted = observed.regions->counted;
    cv::Mat missing = counted - observed.measured;
    grid_.add(missing, counted, missing_);
    grid_.add(counted, counted, count_);
  }

  RawStatistic finish() override { return grid_.means(missing_, count_, 4); }

 private:
  Grid grid_;
  std::vector<double> missing_, count_;
};

}  // namespace

SegmentDeclaration dropout_segment() {
  SegmentDeclaration s;
  s.name = "drop-out";
  s.group = "mask";
  s.unit = "arcsine root of a share";
  s.meaning = "share of pixels without depth in cells";
  s.floor = 0.05;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Dropout>(context);
  };
  s.stabilise = [](float raw, float weight, int, int) { return stabilised_share(raw, weight); };
  return s;
}

}  // namespace binrig
