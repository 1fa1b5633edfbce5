// What becomes of depth: holes, noise, filters, and the way to storage.
#include <climits>
#include <cmath>
#include <numbers>

#include <opencv2/core.hpp>

#include "bench/hidden_effects/shot.h"
#include "core/coherent_noise.h"

namespace binrig::hidden {
namespace {

constexpr double pi = std::numbers::pi;

double intensity(const Channels& seen, int v, int u) { return std::max(0.01f, seen.ir.at<float>(v, u)); }
double incidence(const Channels& seen, int v, int u) {
  return std::acos(std::clamp(seen.cos_incidence.at<float>(v, u), 0.f, 1.f));
}

/// f(p, shot, v, u) -> variance is multiplied by it.
template <typename F>
Injection variance_factor(F f) {
  return {
      Stage::amplitude, [f](const Values& p, const Stand& stand) -> Act {
        return [f, p, stand](Shot& shot, Dice&) {
          shot.each([&](int v, int u) { shot.scale(v, u) *= static_cast<float>(std::sqrt(f(p, stand, shot, v, u))); });
        };
      }};
}

/// Holes where f(p, shot, v, u, dice).
template <typename F>
Injection holes(Stage stage, F f) {
  return {stage, [f](const Values& p, const Stand& stand) -> Act {
            return [f, p, stand](Shot& shot, Dice& dice) {
              shot.lose([&](int v, int u) { return f(p, stand, shot, v, u, dice); });
            };
          }};
}

/// Holes where value(shot, v, u) lies beyond a threshold that is disturbed by a coherent field.
template <typename F>
Injection beyond_disturbed(double unit, F value) {
  return {Stage::signal_mask, [=](const Values& p, const Stand& stand) -> Act {
            auto field =
                std::make_shared<DisturbanceField>(stand.camera.height, stand.camera.width, p.at("grid"), p.at("share"),
                                                   LatticeWeight::cubic, stand.capture_dice().stream());
            return [=](Shot& shot, Dice& dice) {
              const cv::Mat n = field->at(dice.stream());
              shot.lose([&](int v, int u) {
                return value(shot, v, u) > unit * (p.at("threshold") + p.at("disturbance") * n.at<float>(v, u));
              });
            };
          }};
}

Act second_shadow(const Values& p, const Stand& stand) {
  auto gap = std::make_shared<cv::Mat>();
  return [=](Shot& shot, Dice&) {
    if (gap->empty() || stand.moves) {
      const Vector3 place(p.at("baseline"), 0, 0);
      *gap = stand.look(shot.number, shot.time_s, 1, &place, static_cast<ChannelSet>(Channel::projector_gap))
                 ->projector_gap_mm;
    }
    shot.lose([&](int v, int u) { return gap->at<float>(v, u) > 0.05; });
  };
}

Act spectral_noise(const Values& p, const Stand&) {
  return [p](Shot& shot, Dice& dice) {
    const double reach = 2 * pi * p.at("correlation_length"), white = p.at("white_share");
    // g = exp(-(reach f)^2) scaled to mean 1 over all frequencies of this image.
    double mean = 0;
    const auto frequency = [](int k, int n) { return (k <= n / 2 ? k : k - n) / static_cast<double>(n); };
    for (int j = 0; j < shot.z.rows; ++j)
      for (int i = 0; i < shot.z.cols; ++i)
        mean += std::exp(-reach * reach *
                         (std::pow(frequency(j, shot.z.rows), 2) + std::pow(frequency(i, shot.z.cols), 2)));
    mean /= shot.z.total();
    const cv::Mat_<float> n = coloured_noise(shot.z.size(), dice, [&](double fy, double fx) {
      return std::sqrt((1 - white) * std::exp(-reach * reach * (fx * fx + fy * fy)) / mean + white);
    });
    for (int v = 0; v < n.rows; ++v)
      for (int u = 0; u < n.cols; ++u)
        shot.noise(v, u) += static_cast<float>(p.at("sigma") * shot.scale(v, u) * n(v, u));
  };
}

Act noise_bumps(const Values& p, const Stand&) {
  return [p](Shot& shot, Dice& dice) {
    const cv::Mat_<float> n = coloured_noise(shot.z.size(), dice, [&](double fy, double fx) {
      const double f = std::hypot(fx, fy);
      return f == 0 ? 0 : std::exp(-0.25 * std::pow((f - p.at("frequency")) / p.at("width"), 2));
    });
    shot.noise += p.at("amplitude") * n;
  };
}

Act line_noise(const Values& p, bool rows) {
  return [p, rows](Shot& shot, Dice& dice) {
    for (int k = 0; k < (rows ? shot.z.rows : shot.z.cols); ++k) {
      const double n = p.at("amplitude") * dice.normal();
      (rows ? shot.noise.row(k) : shot.noise.col(k)) += n;
    }
  };
}

Act vibration(const Values& p, const Stand&) {
  return [a = p.at("amplitude")](Shot& shot, Dice& dice) {
    const double offset = a * dice.normal(), tilt_x = a * dice.normal(), tilt_y = a * dice.normal();
    shot.each([&](int v, int u) {
      shot.noise(v, u) += static_cast<float>(offset + tilt_x * shot.x(u) + tilt_y * shot.y(v));
    });
  };
}

/// Every pixel with what was measured at the point next to it, on the same surface: the noise, and a part of the depth.
Act fronto_parallel_patches(const Values& p, const Stand& stand) {
  const double pitch = p.at("pitch");
  const int rows = static_cast<int>(stand.camera.height / pitch) + 2,
            cols = static_cast<int>(stand.camera.width / pitch) + 2;
  Dice dice = stand.capture_dice();
  std::vector<cv::Point> points;  // one a square, row by row; in the image or not
  for (int j = 0; j < rows; ++j)
    for (int i = 0; i < cols; ++i) {
      const double x = (i - dice.uniform()) * pitch, y = (j - dice.uniform()) * pitch;
      points.emplace_back(static_cast<int>(std::floor(x)), static_cast<int>(std::floor(y)));
    }
  cv::Mat_<cv::Point> next(stand.camera.height, stand.camera.width);
  for (int v = 0; v < next.rows; ++v)
    for (int u = 0; u < next.cols; ++u) {
      // A point of the 7 x 7 squares around; all points of these that lie in the image are candidates.
      int least = INT_MAX;
      const int row = static_cast<int>(v / pitch) + 1, col = static_cast<int>(u / pitch) + 1;
      for (int j = std::max(0, row - 3); j <= std::min(rows - 1, row + 3); ++j)
        for (int i = std::max(0, col - 3); i <= std::min(cols - 1, col + 3); ++i) {
          const cv::Point at = points[j * cols + i], d = at - cv::Point(u, v);
          if (d.dot(d) < least && cv::Rect({}, next.size()).contains(at)) least = d.dot(d), next(v, u) = at;
        }
    }
  return [=, hold = p.at("hold"), slant = p.at("slant")](Shot& shot, Dice&) {
    const cv::Mat_<float> z = shot.z.clone(), n = shot.noise.clone();
    shot.each([&](int v, int u) {
      const cv::Point at = next(v, u);
      if (shot.hole(at) || cv::norm(at - cv::Point(u, v)) >= shot.seen->edge_px.at<float>(v, u)) return;
      shot.z(v, u) += static_cast<float>(hold * (1 - slant) * (z(at) - z(v, u)));
      shot.noise(v, u) += static_cast<float>(hold * (n(at) - n(v, u)));
    });
  };
}

/// Weighted mean of the depths around: weight(distance^2 in px^2, depth difference).
template <typename F>
void average(Shot& shot, int half, F weight) {
  const cv::Mat_<float> before = shot.z.clone();
  shot.depth([&](double own, int v, int u) {
    double sum = 0, total = 0;
    for (int j = std::max(0, v - half); j <= std::min(before.rows - 1, v + half); ++j)
      for (int i = std::max(0, u - half); i <= std::min(before.cols - 1, u + half); ++i) {
        if (shot.hole(j, i)) continue;
        const double d = before(j, i) - own, w = weight((j - v) * (j - v) + (i - u) * (i - u), d);
        sum += w * d, total += w;
      }
    return own + sum / total;
  });
}

Act bilateral_blur(const Values& p, const Stand&) {
  const double a = 0.5 / std::pow(p.at("sigma_px"), 2), b = 0.5 / std::pow(p.at("sigma_z"), 2);
  return [=, half = static_cast<int>(p.at("diameter")) / 2](Shot& shot, Dice&) {
    average(shot, half, [=](double d2, double dz) { return std::exp(-a * d2 - b * dz * dz); });
  };
}

Act smoothing(const Values& p, const Stand&) {
  const double s = p.at("sigma");
  std::vector<double> table(2 * 81 * 81);
  for (std::size_t d2 = 0; d2 < table.size(); ++d2) table[d2] = std::exp(-0.5 * d2 / (s * s));
  return [=, half = static_cast<int>(std::ceil(4 * s))](Shot& shot, Dice&) {
    average(shot, half, [&](int d2, double) { return table[d2]; });
  };
}

Act hole_filling(const Values& p, const Stand&) {
  return [n = static_cast<int>(p.at("reach"))](Shot& shot, Dice&) {
    const cv::Mat_<uchar> hole = shot.hole.clone();
    const cv::Mat_<float> z = shot.z.clone();
    for (int v = 0; v < z.rows; ++v)
      for (int u = 0; u < z.cols; ++u) {
        if (!hole(v, u)) continue;
        int nearest = n * n + 1;
        for (int j = std::max(0, v - n); j <= std::min(z.rows - 1, v + n); ++j)
          for (int i = std::max(0, u - n); i <= std::min(z.cols - 1, u + n); ++i) {
            const int d2 = (j - v) * (j - v) + (i - u) * (i - u);
            if (hole(j, i) || d2 >= nearest) continue;
            nearest = d2;
            shot.z(v, u) = z(j, i);
            shot.hole(v, u) = 0;
          }
      }
  };
}

Act temporal_filter(const Values& p, const Stand& stand) {
  auto last = std::make_shared<cv::Mat_<float>>(stand.camera.height, stand.camera.width, 0.f);  // 0 = none yet
  return [a = p.at("weight"), last](Shot& shot, Dice&) {
    for (int v = 0; v < shot.z.rows; ++v)
      for (int u = 0; u < shot.z.cols; ++u) {
        float& y = (*last)(v, u);
        if (!shot.hole(v, u)) y = y == 0 ? shot.z(v, u) : static_cast<float>(a * shot.z(v, u) + (1 - a) * y);
        shot.z(v, u) = y;
      }
  };
}

Act frame_repeat(const Values& p, const Stand&) {
  struct Before {
    cv::Mat z, hole;
  };
  auto before = std::make_shared<Before>();
  return [p, before](Shot& shot, Dice& dice) {
    if (!before->z.empty() && dice.uniform() < p.at("probability")) {
      before->z.copyTo(shot.z), before->hole.copyTo(shot.hole);
    } else {
      before->z = shot.z.clone(), before->hole = shot.hole.clone();
    }
  };
}

Act dead_pixels(const Values& p, const Stand& stand) {
  Dice dice = stand.unit_dice();
  cv::Mat_<uchar> dead(stand.camera.height, stand.camera.width);
  for (uchar& pixel : dead) pixel = dice.uniform() < p.at("rate");
  return [dead](Shot& shot, Dice&) { shot.lose([&](int v, int u) { return dead(v, u); }); };
}

std::map<std::string, Injection> table() {
  std::map<std::string, Injection> t;
  t["projector_shadow"] = holes(Stage::signal_mask, [](auto& p, auto&, const Shot& shot, int v, int u, Dice&) {
    return shot.seen->projector_gap_mm.at<float>(v, u) > p.at("bias") + 0.05;
  });
  t["specular_saturation"] =
      beyond_disturbed(1, [](const Shot& shot, int v, int u) { return shot.seen->specular.at<float>(v, u); });
  t["low_confidence"] =
      beyond_disturbed(pi / 180, [](const Shot& shot, int v, int u) { return incidence(*shot.seen, v, u); });
  t["no_return"] = holes(Stage::signal_mask, [](auto& p, auto&, const Shot& shot, int v, int u, Dice&) {
    return shot.seen->diffuse.at<float>(v, u) + shot.seen->specular.at<float>(v, u) < p.at("threshold");
  });
  t["low_signal_dropout"] = holes(Stage::signal_mask, [](auto& p, auto&, const Shot& shot, int v, int u, Dice& dice) {
    return intensity(*shot.seen, v, u) * (1 + 0.15 * dice.normal()) < p.at("threshold");
  });
  t["second_shadow"] = {Stage::signal_mask, second_shadow};

  t["axial_noise"] = variance_factor([](auto& p, const Stand& s, const Shot& shot, int v, int u) {
    return std::pow(shot.seen->depth_mm.at<float>(v, u) / s.z0, 2 * p.at("exponent"));
  });
  t["incidence_noise"] = variance_factor([](auto& p, auto&, const Shot& shot, int v, int u) {
    const double theta = std::min(1.4, incidence(*shot.seen, v, u));
    return 1 + p.at("amplitude") * std::pow(theta / (pi / 2 - theta), 2);
  });
  t["low_signal_noise"] = variance_factor([](auto& p, auto&, const Shot& shot, int v, int u) {
    return std::max(0.2, 1 + p.at("amplitude") * (0.4 / intensity(*shot.seen, v, u) - 1));
  });
  t["ambient_noise"] = variance_factor([](auto& p, auto&, const Shot& shot, int v, int u) {
    const double dx = shot.x(u) - p.at("centre_x"), dy = shot.y(v) - p.at("centre_y");
    const double lobe = std::exp(-0.5 * (dx * dx + dy * dy) / std::pow(p.at("radius"), 2));
    return 1 + p.at("amplitude") * lobe * std::pow(0.4 / intensity(*shot.seen, v, u), 2);
  });
  t["heavy_tails"] = {Stage::amplitude, [](const Values& p, const Stand&) -> Act {
                        return [p](Shot& shot, Dice& dice) {
                          shot.each([&](int v, int u) {
                            if (dice.uniform() < p.at("rate")) shot.scale(v, u) *= static_cast<float>(p.at("factor"));
                          });
                        };
                      }};

  t["spectral_noise"] = {Stage::noise, spectral_noise};
  t["row_noise"] = {Stage::noise, [](const Values& p, const Stand&) { return line_noise(p, true); }};
  t["column_noise"] = {Stage::noise, [](const Values& p, const Stand&) { return line_noise(p, false); }};
  t["noise_bumps"] = {Stage::noise, noise_bumps};
  t["vibration"] = {Stage::noise, vibration};
  t["fronto_parallel_patches"] = {Stage::noise, fronto_parallel_patches};

  t["bilateral_blur"] = {Stage::spatial, bilateral_blur};
  t["smoothing"] = {Stage::spatial, smoothing};
  t["hole_filling"] = {Stage::spatial, hole_filling};
  t["disparity_quantisation"] = {Stage::quantise, [](const Values& p, const Stand& stand) -> Act {
                                   return [q = p.at("step"), fb = stand.focal_baseline](Shot& shot, Dice&) {
                                     shot.depth([&](double z, int, int) { return fb / (q * std::round(fb / z / q)); });
                                   };
                                 }};
  t["temporal_filter"] = {Stage::temporal, temporal_filter};
  t["frame_repeat"] = {Stage::temporal, frame_repeat};
  t["border_band"] = holes(Stage::device, [](auto& p, const Stand& s, const Shot& shot, int v, int u, Dice&) {
    return u < p.at("width") * s.z0 / shot.z(v, u);  // the projector stands at +x in every campaign
  });
  t["dead_pixels"] = {Stage::device, dead_pixels};
  t["random_dropout"] =
      holes(Stage::device, [](auto& p, auto&, auto&, int, int, Dice& dice) { return dice.uniform() < p.at("rate"); });
  t["dust"] = holes(Stage::device, [](auto& p, auto&, const Shot& shot, int v, int u, Dice& dice) {
    const double px = std::hypot(shot.x(u) - p.at("x"), shot.y(v) - p.at("y")) / shot.per_px;
    return px < p.at("radius") + 0.7 * dice.normal();
  });
  t["depth_units"] = {Stage::storage, [](const Values& p, const Stand&) -> Act {
                        return [q = p.at("step")](Shot& shot, Dice&) {
                          shot.depth([&](double z, int, int) { return q * std::round(z / q); });
                        };
                      }};
  return t;
}

}  // namespace

const std::map<std::string, Injection>& signal_injections() {
  static const auto t = table();
  return t;
}

cv::Mat_<float> coloured_noise(cv::Size size, Dice& dice, const std::function<double(double, double)>& gain) {
  cv::Mat_<float> white(size);
  for (float& value : white) value = static_cast<float>(dice.normal());
  cv::Mat_<cv::Vec2f> line;
  cv::dft(white, line, cv::DFT_COMPLEX_OUTPUT);
  double power = 0;
  const auto frequency = [](int k, int n) { return (k <= n / 2 ? k : k - n) / static_cast<double>(n); };
  for (int j = 0; j < size.height; ++j)
    for (int i = 0; i < size.width; ++i) {
      const double a = gain(frequency(j, size.height), frequency(i, size.width));
      power += a * a;
      line(j, i) *= static_cast<float>(a);
    }
  cv::Mat_<float> result;
  cv::dft(line, result, cv::DFT_INVERSE | cv::DFT_REAL_OUTPUT | cv::DFT_SCALE);
  return result / std::sqrt(power / size.area());
}

}  // namespace binrig::hidden
