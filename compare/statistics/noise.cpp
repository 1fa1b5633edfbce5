// Noise: pooled variance of the random part (successive frames' difference) in cells of the interior.
#include <cmath>

#include "compare/statistic.h"
#include "compare/statistics/grid.h"

namespace binrig {
namespace {

class Noise : public Statistic {
 public:
  explicit Noise(const StatisticContext& context)
      : pairs_(std::max(1, context.frames - 1)),
        grid_(context, context.cell_px()),
        sum_(grid_.size()),
        count_(grid_.size()) {}

  void add(const ObservedFrame& observed) override {
    if (observed.random_mm.empty()) return;
    grid_.add(observed.random_mm, observed.random_mm, sum_);  // random_mm is 0 where unused
    grid_.add(observed.random_used, observed.random_used, count_);
  }

  RawStatistic finish() override { return grid_.means(sum_, count_, 0.25 * pairs_ * grid_.side() * grid_.side()); }

 private:
  int pairs_;
  Grid grid_;
  std::vector<double> sum_, count_;
};

}  // namespace

SegmentDeclaration noise_segment() {
  SegmentDeclaration s;
  s.name = "noise";
  s.group = "noise";
  s.unit = "ln of variance";
  s.meaning = "variance of the random part in cells, mm^2";
  s.floor = 0.05;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Noise>(context);
  };
  // 1e-6 mm^2 (a micrometre) keeps repeated frames, whose variance is 0, finite.
  s.stabilise = [](float raw, float, int, int) { return std::log(raw + 1e-6f); };
  return s;
}

}  // namespace binrig
