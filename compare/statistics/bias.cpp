// Bias: the mean over frames of depth minus the perfect depth of the nominal scene, in bins of the interior.
#include "compare/statistic.h"
#include "compare/statistics/grid.h"

namespace binrig {
namespace {

class Bias : public Statistic {
 public:
  explicit Bias(const StatisticContext& context)
      : frames_(context.frames), grid_(context, context.bin_px()), sum_(grid_.size()), count_(grid_.size()) {}

  void add(const ObservedFrame& observed) override {
    grid_.add(observed.residual_mm, observed.used, sum_);
    grid_.add(observed.used, observed.used, count_);
  }

  RawStatistic finish() override {
    // A bin that is seen in less than a quarter of its samples says more about who was left out than about depth.
    return grid_.means(sum_, count_, 0.25 * frames_ * grid_.side() * grid_.side());
  }

 private:
  int frames_;
  Grid grid_;
  std::vector<double> sum_, count_;
};

}  // namespace

SegmentDeclaration bias_segment() {
  SegmentDeclaration s;
  s.name = "bias";
  s.group = "bias";
  s.unit = "mm";
  s.meaning = "mean depth error of a bin over the frames of a capture";
  s.floor = 0.02;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Bias>(context);
  };
  s.stabilise = [](float raw, float, int, int) { return raw; };
  return s;
}

}  // namespace binrig
