// Edges: what happens beside depth edges, by the edge's orientation (the side on which the background lies: right,
// below, left, above) and the signed distance to it (8 bins of 1 px, foreground negative).
//
// The mixing ratio of a depth is 0 on the foreground and 1 on the background. Its jitter is the mean absolute change
// between frames: of squares, a single outlier in a cell would make more than everything else.
#include <cmath>

#include "compare/statistic.h"

namespace binrig {
namespace {

constexpr int classes = edge_orientations * edge_bins;
constexpr double fewest_samples = 30;

class Edges : public Statistic {
 public:
  explicit Edges(const StatisticContext&) {}

  void add(const ObservedFrame& observed) override {
    const float* z = observed.frame->depth_mm.ptr<float>();
    const auto& edges = observed.regions->edges;
    const bool same = previous_.size() == edges.size() && regions_ == observed.regions_number;
    previous_.resize(edges.size(), -10.f);
    for (std::size_t i = 0; i < edges.size(); ++i) {
      const auto& e = edges[i];
      seen_[e.cell] += 1;
      const float before = same ? previous_[i] : -10.f;
      previous_[i] = -10.f;
      if (z[e.index] <= 0) {
        missing_[e.cell] += 1;
        continue;
      }
      const float mix = std::clamp((z[e.index] - e.fore_mm) / (e.back_mm - e.fore_mm), -0.5f, 1.5f);
      previous_[i] = mix;
      valid_[e.cell] += 1;
      mix_[e.cell] += mix;
      between_[e.cell] += mix > 0.15f && mix < 0.85f;
      if (before > -5.f) {
        pairs_[e.cell] += 1;
        change_[e.cell] += std::abs(mix - before);
      }
    }
    regions_ = observed.regions_number;
  }

  RawStatistic finish() override {
    RawStatistic raw;
    raw.cols = 4 * classes;
    raw.value.assign(raw.cols, 0.f);
    raw.weight.assign(raw.cols, 0.f);
    const auto set = [&](int kind, int c, double sum, double count) {
      if (count < fewest_samples) return;
      raw.value[kind * classes + c] = static_cast<float>(sum / count);
      raw.weight[kind * classes + c] = static_cast<float>(count);
    };
    for (int c = 0; c < classes; ++c) {
      set(0, c, mix_[c], valid_[c]);
      set(1, c, change_[c], pairs_[c]);
      set(2, c, between_[c], valid_[c]);
      set(3, c, missing_[c], seen_[c]);
    }
    return raw;
  }

 private:
  int regions_ = 0;
  std::vector<float> previous_;
  double seen_[classes] = {}, valid_[classes] = {}, missing_[classes] = {}, mix_[classes] = {}, between_[classes] = {},
         pairs_[classes] = {}, change_[classes] = {};
};

}  // namespace

SegmentDeclaration edges_segment() {
  SegmentDeclaration s;
  s.name = "edges";
  s.group = "edges";
  s.unit = "mixing ratio, ln of its mean change, arcsine root of a share";
  s.meaning = "mixing of fore- and background, its jitter, in-between depths and holes beside depth edges";
  s.floor = 0.02;
  s.begin = [](const StatisticContext& context) -> std::unique_ptr<Statistic> {
    return std::make_unique<Edges>(context);
  };
  s.stabilise = [](float raw, float weight, int i, int n) {
    const int kind = i / (n / 4);
    if (kind == 0) return raw;
    if (kind == 1) return 0.5f * std::log(raw + 1e-3f);
    return stabilised_share(raw, weight);
  };
  return s;
}

}  // namespace binrig
