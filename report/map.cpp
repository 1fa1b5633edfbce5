#include "report/map.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "core/error.h"

namespace binrig {

namespace {

constexpr int largest_side = 720;

int step_for(const cv::Size& size) {
  return std::max(1, (std::max(size.width, size.height) + largest_side - 1) / largest_side);
}

cv::Scalar scalar(Rgb colour) { return {double(colour[0]), double(colour[1]), double(colour[2])}; }

void write_text(cv::Mat& image, const std::string& text, cv::Point at, double size = 0.45) {
  cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, size, {40, 44, 52}, 1, cv::LINE_AA);
}

int text_width(const std::string& text, double size) {
  int below = 0;
  return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, size, 1, &below).width;
}

// Panels side by side with their titles above; `below` more rows are left white for a legend.
cv::Mat lay_out(const std::vector<PanelImage>& images, const std::vector<std::string>& titles, int right, int below) {
  constexpr int gap = 16, top = 28;
  int width = gap, height = 0;
  std::vector<cv::Mat> shown;
  for (const PanelImage& image : images) {
    // Small maps are enlarged by whole factors, so that a pixel stays a square.
    const int factor = std::max(1, 480 / std::max(1, std::max(image.index.cols, image.index.rows)));
    cv::Mat large;
    cv::resize(image.rgb(), large, {}, factor, factor, cv::INTER_NEAREST);
    shown.push_back(large);
    width += large.cols + gap;
    height = std::max(height, large.rows);
  }
  cv::Mat sheet(top + height + gap + below, width + right, CV_8UC3, cv::Scalar(255, 255, 255));
  int x = gap;
  for (std::size_t i = 0; i < shown.size(); ++i) {
    write_text(sheet, titles[i], {x, 19});
    shown[i].copyTo(sheet(cv::Rect(x, top, shown[i].cols, shown[i].rows)));
    x += shown[i].cols + gap;
  }
  return sheet;
}

bool has_value(const MapPanel& panel, int row, int col) {
  if (!panel.valid.empty() && panel.valid.at<std::uint8_t>(row, col) == 0) return false;
  return std::isfinite(panel.values.at<float>(row, col));
}

void check(const MapFigure& figure) {
  Violations violations;
  if (figure.panels.empty()) violations.add("map " + figure.name, "", "has no panel");
  for (const MapPanel& panel : figure.panels) {
    if (panel.values.type() != CV_32F || panel.values.empty()) {
      violations.add("map " + figure.name, panel.title, "values must be a CV_32F image");
    } else if (!panel.valid.empty() && (panel.valid.size() != panel.values.size() || panel.valid.type() != CV_8U)) {
      violations.add("map " + figure.name, panel.title, "valid must be a CV_8U image of the values' size");
    }
  }
  if (figure.low > figure.high) violations.add("map " + figure.name, "low", "lies above high");
  violations.throw_if_any("a map cannot be drawn");
}

}  // namespace

std::vector<double> round_ticks(double low, double high) {
  const double span = high - low;
  if (!(span > 0) || !std::isfinite(span)) return {low};
  const double raw = span / 5, power = std::pow(10.0, std::floor(std::log10(raw)));
  const double lead = raw / power;
  const double step = power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
  std::vector<double> ticks;
  for (long k = std::lround(std::ceil(low / step - 1e-9)); k * step <= high + 1e-9 * span; ++k)
    ticks.push_back(k * step);
  return ticks;
}

void choose_scale(MapFigure& figure) {
  check(figure);
  if (figure.low != 0 || figure.high != 0) {
    if (figure.low == figure.high) figure.high = figure.low + 1e-6 + std::abs(figure.low) * 1e-6;
    return;
  }
  std::vector<float> sample;
  for (const MapPanel& panel : figure.panels) {
    // About 40,000 pixels a panel settle the 1 % quantile to a few per cent of its own probability.
    const int step = std::max(1, static_cast<int>(std::sqrt(panel.values.total() / 40000.0)));
    for (int r = 0; r < panel.values.rows; r += step) {
      for (int c = 0; c < panel.values.cols; c += step) {
        if (has_value(panel, r, c)) sample.push_back(panel.values.at<float>(r, c));
      }
    }
  }
  if (sample.empty()) sample.push_back(0.f);
  const auto quantile = [&](double q) {
    const auto k = static_cast<std::ptrdiff_t>(q * (sample.size() - 1) + 0.5);
    std::nth_element(sample.begin(), sample.begin() + k, sample.end());
    return static_cast<double>(sample[k]);
  };
  figure.low = quantile(0.01);
  figure.high = quantile(0.99);
  if (figure.colours == ColourScale::diverging) {
    figure.high = std::max(std::abs(figure.low), std::abs(figure.high));
    figure.low = -figure.high;
  }
  if (!(figure.high > figure.low)) figure.high = figure.low + 1e-6 + std::abs(figure.low) * 1e-6;
}

cv::Mat PanelImage::rgb() const {
  cv::Mat out(index.size(), CV_8UC3);
  for (int r = 0; r < index.rows; ++r) {
    for (int c = 0; c < index.cols; ++c) {
      const Rgb& colour = palette[index.at<std::uint8_t>(r, c)];
      out.at<cv::Vec3b>(r, c) = {colour[0], colour[1], colour[2]};
    }
  }
  return out;
}

PanelImage colour_panel(const MapPanel& panel, double low, double high, ColourScale colours) {
  const auto& table = scale_colours(colours);
  PanelImage out;
  out.palette.assign(table.begin(), table.end());
  out.palette.push_back(absent_colour);
  out.step = step_for(panel.values.size());
  out.index.create((panel.values.rows + out.step - 1) / out.step, (panel.values.cols + out.step - 1) / out.step, CV_8U);
  constexpr double last = scale_steps - 1;
  for (int r = 0; r < out.index.rows; ++r) {
    for (int c = 0; c < out.index.cols; ++c) {
      auto& index = out.index.at<std::uint8_t>(r, c);
      index = scale_steps;
      if (!has_value(panel, r * out.step, c * out.step)) continue;
      const double place = (panel.values.at<float>(r * out.step, c * out.step) - low) / (high - low) * last;
      index = static_cast<std::uint8_t>(std::lround(std::clamp(place, 0.0, last)));
    }
  }
  return out;
}

PanelImage colour_panel(const CategoryPanel& panel, const std::vector<Category>& categories) {
  if (panel.labels.type() != CV_8U || panel.labels.empty()) {
    throw Error("a map of kinds cannot be drawn: " + panel.title + " must be a CV_8U image");
  }
  if (categories.size() > 255) throw Error("a map of kinds has at most 255 of them");
  PanelImage out;
  for (const Category& kind : categories) out.palette.push_back(kind.colour);
  out.palette.push_back(absent_colour);
  out.step = step_for(panel.labels.size());
  out.index.create((panel.labels.rows + out.step - 1) / out.step, (panel.labels.cols + out.step - 1) / out.step, CV_8U);
  for (int r = 0; r < out.index.rows; ++r) {
    for (int c = 0; c < out.index.cols; ++c) {
      const std::size_t label = panel.labels.at<std::uint8_t>(r * out.step, c * out.step);
      out.index.at<std::uint8_t>(r, c) = static_cast<std::uint8_t>(std::min(label, categories.size()));
    }
  }
  return out;
}

cv::Mat compose(const MapFigure& given) {
  MapFigure figure = given;
  choose_scale(figure);
  std::vector<PanelImage> images;
  std::vector<std::string> titles;
  for (const MapPanel& panel : figure.panels) {
    images.push_back(colour_panel(panel, figure.low, figure.high, figure.colours));
    titles.push_back(panel.title);
  }
  constexpr int bar_space = 110, bar_width = 16;
  cv::Mat sheet = lay_out(images, titles, bar_space, 0);
  const int top = 28, bottom = sheet.rows - 16, x = sheet.cols - bar_space;
  const auto& table = scale_colours(figure.colours);
  for (int y = top; y < bottom; ++y) {
    const int k = static_cast<int>(std::lround((scale_steps - 1.0) * (bottom - 1 - y) / std::max(1, bottom - 1 - top)));
    cv::line(sheet, {x, y}, {x + bar_width, y}, scalar(table[k]));
  }
  for (const double tick : round_ticks(figure.low, figure.high)) {
    const int y = static_cast<int>(
        std::lround(bottom - 1 - (tick - figure.low) / (figure.high - figure.low) * (bottom - 1 - top)));
    cv::line(sheet, {x + bar_width, y}, {x + bar_width + 4, y}, {90, 94, 102});
    write_text(sheet, fmt::format("{:.6g}", std::abs(tick) < 1e-12 ? 0.0 : tick), {x + bar_width + 8, y + 4}, 0.4);
  }
  write_text(sheet, figure.unit, {x, 19}, 0.4);
  return sheet;
}

cv::Mat compose(const CategoryFigure& figure) {
  std::vector<PanelImage> images;
  std::vector<std::string> titles;
  std::vector<bool> present(256);
  for (const CategoryPanel& panel : figure.panels) {
    images.push_back(colour_panel(panel, figure.categories));
    titles.push_back(panel.title);
    for (int r = 0; r < panel.labels.rows; ++r) {
      for (int c = 0; c < panel.labels.cols; ++c) present[panel.labels.at<std::uint8_t>(r, c)] = true;
    }
  }
  const int shown = static_cast<int>(
      std::count(present.begin(), present.begin() + std::min<std::size_t>(256, figure.categories.size()), true));
  constexpr int line = 20, box = 19, gap = 18;
  int column = 1;
  for (std::size_t i = 0; i < figure.categories.size(); ++i)
    if (present[i]) column = std::max(column, box + text_width(figure.categories[i].label, 0.4) + gap);
  cv::Mat sheet = lay_out(images, titles, 0, 0);
  const int columns = std::max(1, (sheet.cols - 16) / column), lines = (shown + columns - 1) / columns;
  cv::copyMakeBorder(sheet, sheet, 0, lines * line + 8, 0, 0, cv::BORDER_CONSTANT, {255, 255, 255});
  int k = 0;
  for (std::size_t i = 0; i < figure.categories.size(); ++i) {
    if (!present[i]) continue;
    const cv::Point at(16 + (k % columns) * column, sheet.rows - lines * line - 4 + (k / columns) * line);
    cv::rectangle(sheet, cv::Rect(at.x, at.y, 13, 13), scalar(figure.categories[i].colour), cv::FILLED);
    cv::rectangle(sheet, cv::Rect(at.x, at.y, 13, 13), {140, 144, 150});
    write_text(sheet, figure.categories[i].label, {at.x + box, at.y + 11}, 0.4);
    ++k;
  }
  return sheet;
}

}  // namespace binrig
