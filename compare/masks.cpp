#include "compare/masks.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/random.h"

namespace binrig {

namespace {

MaskTally::Block& operator+=(MaskTally::Block& a, const MaskTally::Block& b) {
  a.pixels += b.pixels;
  a.missing += b.missing;
  for (int r = 0; r < reason_count; ++r) {
    a.predicted[r] += b.predicted[r];
    a.hit[r] += b.hit[r];
  }
  return a;
}

double ratio(double a, double b) { return b > 0 ? a / b : 0; }

// precision, recall, IoU of all reasons together, then of each.
std::vector<double> shares(const MaskTally::Block& sum) {
  std::vector<double> out;
  double predicted = 0, hit = 0;
  for (int r = 1; r < reason_count; ++r) {
    predicted += sum.predicted[r];
    hit += sum.hit[r];
  }
  const auto add = [&](double p, double h) {
    out.push_back(ratio(h, p));
    out.push_back(ratio(h, sum.missing));
    out.push_back(ratio(h, p + sum.missing - h));
  };
  add(predicted, hit);
  for (int r = 0; r < reason_count; ++r) add(sum.predicted[r], sum.hit[r]);
  return out;
}

}  // namespace

void MaskTally::add(const cv::Mat& measured, const cv::Mat& predicted, const cv::Mat& counted) {
  if (measured.size() != predicted.size() || measured.size() != counted.size()) {
    throw Error("masks of different sizes cannot be compared");
  }
  const int across = (measured.cols + block_px - 1) / block_px, down = (measured.rows + block_px - 1) / block_px;
  // Frames of one capture see the same patches: they fall into the same blocks.
  if (blocks_.empty()) blocks_.resize(static_cast<std::size_t>(across) * down);
  for (int r = 0; r < measured.rows; ++r) {
    const auto *m = measured.ptr<std::uint8_t>(r), *p = predicted.ptr<std::uint8_t>(r),
               *c = counted.ptr<std::uint8_t>(r);
    for (int x = 0; x < measured.cols; ++x) {
      if (!c[x]) continue;
      Block& block = blocks_[static_cast<std::size_t>(r / block_px) * across + x / block_px];
      block.pixels += 1;
      block.missing += m[x] != 0;
      if (p[x] == 0 || p[x] >= reason_count) continue;
      block.predicted[p[x]] += 1;
      block.hit[p[x]] += m[x] != 0;
    }
  }
}

MaskScore mask_score(const std::string& model, const std::vector<const MaskTally*>& tallies, std::uint64_t seed) {
  std::vector<const MaskTally::Block*> blocks;
  MaskTally::Block sum;
  for (const MaskTally* tally : tallies) {
    for (const auto& block : tally->blocks()) {
      if (block.pixels <= 0) continue;
      blocks.push_back(&block);
      sum += block;
    }
  }
  constexpr int draws = 1000;
  const auto values = shares(sum);
  std::vector<std::vector<double>> samples(values.size());
  const RandomStream stream = RandomStream(seed).child("block bootstrap");
  for (int d = 0; d < draws && !blocks.empty(); ++d) {
    MaskTally::Block drawn;
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      drawn += *blocks[static_cast<std::size_t>(stream.uniform(d * blocks.size() + i) * blocks.size())];
    }
    const auto one = shares(drawn);
    for (std::size_t i = 0; i < one.size(); ++i) samples[i].push_back(one[i]);
  }
  const auto interval = [&](std::size_t i) {
    ShareInterval out{values[i], 0, 1};
    auto& s = samples[i];
    if (s.empty()) return out;
    std::sort(s.begin(), s.end());
    out.low = s[static_cast<std::size_t>(0.025 * (s.size() - 1))];
    out.high = s[static_cast<std::size_t>(0.975 * (s.size() - 1))];
    return out;
  };
  MaskScore out;
  out.model = model;
  out.pixels = sum.pixels;
  out.missing_share = ratio(sum.missing, sum.pixels);
  out.precision = interval(0);
  out.recall = interval(1);
  out.iou = interval(2);
  out.unexplained = {1 - out.recall.value, 1 - out.recall.high, 1 - out.recall.low};
  for (int r = 1; r < reason_count; ++r) {
    if (sum.predicted[r] <= 0) continue;
    out.predicted_share += ratio(sum.predicted[r], sum.pixels);
    const std::size_t at = 3 + 3 * static_cast<std::size_t>(r);
    out.by_reason.push_back({static_cast<Reason>(r), ratio(sum.predicted[r], sum.pixels), interval(at),
                             interval(at + 1), interval(at + 2)});
  }
  return out;
}

cv::Mat outcome_map(const cv::Mat& measured, const cv::Mat& predicted, const cv::Mat& counted) {
  cv::Mat out(measured.size(), CV_8U, cv::Scalar(0));
  for (int r = 0; r < out.rows; ++r) {
    for (int c = 0; c < out.cols; ++c) {
      if (!counted.at<std::uint8_t>(r, c)) continue;
      const bool m = measured.at<std::uint8_t>(r, c) != 0, p = predicted.at<std::uint8_t>(r, c) != 0;
      out.at<std::uint8_t>(r, c) = m ? (p ? 2 : 3) : (p ? 4 : 1);
    }
  }
  return out;
}

}  // namespace binrig
