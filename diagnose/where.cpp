#include "diagnose/where.h"

#include <algorithm>
#include <cmath>
#include <map>

#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "diagnose/cells.h"
#include "diagnose/climb.h"

namespace binrig {
namespace {

constexpr int classes = 12;          // of a covariate, of equal number
constexpr int fewest_cells = 60;     // for curves over covariates
constexpr int shown_covariates = 2;  // of a segment
constexpr double two_sided_95 = 1.96;

StatVector left_by(const Layout& layout, const std::vector<SceneMotion>& motions, const StatVector& measured,
                   const Rung& rung) {
  StatVector left = measured;
  for (std::size_t i = 0; i < left.size(); ++i) left[i] -= rung.standard.mean()[i];
  return registered(layout, motions, std::move(left), rung.place, rung.nuisances);
}

}  // namespace

/// How a segment's differences are shown.
struct Where::Plain {
  std::string segment, label;
  int maps = 0;  ///< how many are drawn
  double even = 0;
  /// Of a difference of stabilised values and the value that was measured.
  double (*change)(double difference, double measured);
  /// Of a mean of these.
  double (*shown)(double mean) = [](double mean) { return mean; };
};

const std::vector<Where::Plain>& Where::plain_units() {
  static const std::vector<Plain> all{
      {"bias", "depth, measured less simulated (mm)", 6, 0, [](double difference, double) { return difference; }},
      {"noise", "standard deviation, measured over simulated", 2, 1,
       [](double difference, double) { return 0.5 * difference; }, [](double mean) { return std::exp(mean); }},
      {"drop-out", "share without depth, measured less simulated", 2, 0,
       [](double difference, double measured) {
         return std::pow(std::sin(measured), 2) - std::pow(std::sin(measured - difference), 2);
       }},
      {"spectrum", "power of the noise, measured over simulated (dB)", 0, 0,
       [](double difference, double) { return 10 / std::log(10.0) * difference; }},
  };
  return all;
}

Where::Where(const Experiment& experiment, const std::vector<SceneMotion>& motions, const StatVector& measured,
             const Rung& first, const Rung& last)
    : experiment_(experiment),
      measured_(measured),
      first_(first),
      last_(last),
      first_left_(left_by(experiment.layout(), motions, measured, first)),
      last_left_(left_by(experiment.layout(), motions, measured, last)),
      own_(last.nulls.size()) {
  parallel_for(static_cast<int>(own_.size()), [&](int k) {
    own_[k] = remains_of(last, last.nulls[k], {}).rest;
    for (std::size_t i = 0; i < own_[k].size(); ++i) own_[k][i] *= last.standard.spread()[i];
  });
}

double Where::change(const Plain& plain, int element, bool last) const {
  return plain.change((last ? last_left_ : first_left_)[element], measured_[element]);
}

std::vector<Maps> Where::maps() const {
  std::vector<Maps> all;
  for (const Plain& plain : plain_units()) {
    std::vector<std::pair<double, const Block*>> blocks;  // what is left by the model given
    for (const Block& block : experiment_.layout().blocks) {
      if (segments()[block.segment].name != plain.segment) continue;
      double square = 0;
      for (int i = block.offset; i < block.offset + block.size; ++i)
        square += static_cast<double>(first_.rest[i]) * first_.rest[i];
      blocks.emplace_back(square, &block);
    }
    std::stable_sort(blocks.begin(), blocks.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
    blocks.resize(std::min<std::size_t>(blocks.size(), plain.maps));
    for (const auto& [square, block] : blocks) {
      Maps maps{plain.segment, plain.label, capture_name(experiment_, block->capture), plain.even, {}, {}, {}};
      maps.before = cv::Mat(block->rows, block->cols, CV_32F, cv::Scalar(plain.even));
      maps.after = maps.before.clone();
      maps.valid = cv::Mat::zeros(block->rows, block->cols, CV_8U);
      for (int i = 0; i < block->size; ++i) {
        const double before = change(plain, block->offset + i, false), after = change(plain, block->offset + i, true);
        if (std::isnan(before) || std::isnan(after)) continue;
        maps.valid.ptr<std::uint8_t>()[i] = 255;
        maps.before.ptr<float>()[i] = static_cast<float>(plain.shown(before));
        maps.after.ptr<float>()[i] = static_cast<float>(plain.shown(after));
      }
      if (cv::countNonZero(maps.valid) > 0) all.push_back(std::move(maps));
    }
  }
  return all;
}

Course Where::course(const Plain& plain, const std::vector<Class>& list) const {
  Course course;
  course.segment = plain.segment;
  course.label = plain.label;
  course.even = plain.even;
  for (const Class& one : list) {
    double before = 0, after = 0, count = 0, own = 0, own_square = 0;
    std::vector<int> known;
    for (const int element : one.elements) {
      const double b = change(plain, element, false), a = change(plain, element, true);
      if (std::isnan(b) || std::isnan(a)) continue;
      before += b, after += a, count += 1;
      known.push_back(element);
    }
    if (known.empty() || own_.empty()) continue;
    for (const StatVector& simulation : own_) {
      double mean = 0;
      for (const int element : known) mean += plain.change(simulation[element], measured_[element]) / count;
      own += mean / own_.size();
      own_square += mean * mean / own_.size();
    }
    const double reach = two_sided_95 * std::sqrt(std::max(0.0, own_square - own * own));
    course.at.push_back(one.at);
    course.before.push_back(plain.shown(before / count));
    course.after.push_back(plain.shown(after / count));
    course.low.push_back(plain.shown(-reach));
    course.high.push_back(plain.shown(reach));
  }
  return course;
}

std::vector<Course> Where::over_covariates(const Plain& plain) const {
  std::vector<MapCell> cells = cells_of(experiment_, last_, measured_, plain.segment);
  std::erase_if(cells, [](const MapCell& cell) { return cell.train; });
  std::vector<std::pair<double, Course>> found;  // how far it goes wrong, in what the last model's simulations do
  for (std::size_t k = 0; static_cast<int>(cells.size()) >= fewest_cells && k < covariates().size(); ++k) {
    const Covariate& covariate = covariates()[k];
    std::stable_sort(cells.begin(), cells.end(),
                     [&](const MapCell& a, const MapCell& b) { return a.covariates[k] < b.covariates[k]; });
    if (!(cells.back().covariates[k] > cells.front().covariates[k])) continue;
    std::vector<Class> list(classes);
    for (std::size_t i = 0; i < cells.size(); ++i) {
      Class& one = list[i * classes / cells.size()];
      one.at += covariate.scale * cells[i].covariates[k];
      one.elements.push_back(cells[i].index);
    }
    for (Class& one : list) one.at /= static_cast<double>(one.elements.size());
    // Targets that face the camera share one value, but for rounding: their classes are one.
    const double same = 1e-6 * (list.back().at - list.front().at);
    for (std::size_t i = 1; i < list.size();) {
      if (list[i].at > list[i - 1].at + same) {
        ++i;
        continue;
      }
      list[i - 1].elements.insert(list[i - 1].elements.end(), list[i].elements.begin(), list[i].elements.end());
      list.erase(list.begin() + static_cast<std::ptrdiff_t>(i));
    }
    Course over = course(plain, list);
    if (over.at.size() < 2) continue;
    over.covariate = covariate.name;
    over.covariate_label = covariate.label;
    double wrong = 0;
    for (std::size_t i = 0; i < over.at.size(); ++i) {
      const double half = std::max(1e-9, 0.5 * (over.high[i] - over.low[i]));
      wrong += std::pow((over.before[i] - over.even) / half, 2) / static_cast<double>(over.at.size());
    }
    found.emplace_back(wrong, std::move(over));
  }
  std::stable_sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first > b.first; });
  found.resize(std::min<std::size_t>(found.size(), shown_covariates));
  std::vector<Course> result;
  for (auto& [wrong, over] : found) result.push_back(std::move(over));
  return result;
}

Course Where::over_frequency(const Plain& plain, int segment) const {
  std::map<double, std::vector<int>> by_frequency;
  for (const Block& block : experiment_.layout().blocks)
    if (block.segment == segment && !block.train)
      for (int i = 0; i < block.size; ++i)
        if (const double frequency = segments()[segment].frequency_px(i); frequency > 0)
          by_frequency[frequency].push_back(block.offset + i);
  std::vector<Class> list;
  for (auto& [frequency, elements] : by_frequency) list.push_back({frequency, std::move(elements)});
  Course over = course(plain, list);
  over.covariate = "frequency";
  over.covariate_label = "frequency (cycles/px)";
  return over;
}

std::vector<Course> Where::courses() const {
  std::vector<Course> all;
  for (const Plain& plain : plain_units()) {
    const auto declared = std::find_if(segments().begin(), segments().end(),
                                       [&](const SegmentDeclaration& s) { return s.name == plain.segment; });
    if (!declared->frequency_px) {
      for (Course& over : over_covariates(plain)) all.push_back(std::move(over));
    } else if (Course over = over_frequency(plain, static_cast<int>(declared - segments().begin()));
               over.at.size() > 1) {
      all.push_back(std::move(over));
    }
  }
  return all;
}

}  // namespace binrig
