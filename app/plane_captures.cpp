#include "app/plane_captures.h"

#include <algorithm>
#include <mutex>
#include <optional>

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "core/progress.h"

namespace binrig {

PlaneCaptures open_plane_captures(const std::string& path, const std::string& only) {
  PlaneCaptures planes{RecordingSet::open(path), {}, {}, {}};
  std::vector<CaptureReader> wanted;
  if (!only.empty()) wanted.push_back(planes.set.capture(only));
  for (const CaptureInfo& info : planes.set.captures()) {
    if (info.target != TargetKind::plane || (!only.empty() && (info.split == "train" || info.key() == only))) continue;
    wanted.push_back(planes.set.capture(info.key()));
  }
  std::vector<std::optional<FirstLook>> looks(wanted.size());
  std::vector<std::string> problems(wanted.size());
  Progress progress("fitting planes", static_cast<std::int64_t>(wanted.size()));
  parallel_for(static_cast<int>(wanted.size()), [&](int i) {
    const CaptureReader& reader = wanted[static_cast<std::size_t>(i)];
    try {
      if (!reader.has_depth() || reader.size() == 0) throw Error(reader.info().key() + " has no depth");
      const Frame first = reader.frame(0);
      looks[static_cast<std::size_t>(i)] = look_at(reader.info().key(), reader.info().name, first, reader.size(),
                                                   marked_region(first, planes.set.info().region_masks));
    } catch (const Error& error) {
      problems[static_cast<std::size_t>(i)] = error.what();
    }
    progress.advance();
  });
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    if (!problems[i].empty()) planes.notes.push_back("left out: " + problems[i]);
    if (!looks[i]) continue;
    const bool to_fit = only.empty() ? wanted[i].info().split == "train" : i == 0;
    (to_fit ? planes.train : planes.test).push_back(*looks[i]);
  }
  if (planes.train.empty()) {
    std::string all;
    for (const auto& note : planes.notes) all += "\n  " + note;
    throw Error(path + " has no plane capture to fit to" + all);
  }
  return planes;
}

LowFrequencies measure_plane_captures(PlaneCaptures& planes, std::vector<CaptureNoise>& train,
                                      std::vector<CaptureNoise>& test) {
  std::vector<std::vector<double>> powers;
  std::vector<double> sigmas;
  double pixels = 0;
  int side = 1 << 20;
  for (const auto* looks : {&planes.train, &planes.test}) {
    for (const FirstLook& look : *looks) {
      const cv::Rect box = cv::boundingRect(look.plane.region);
      side = std::min({side, box.width, box.height});
      if (looks != &planes.train) continue;
      powers.push_back(look.order_powers);
      sigmas.push_back(std::max(look.plane.rms_z_mm, 1e-6));
      pixels = std::max(pixels, static_cast<double>(look.plane.pixels) * std::min(look.frames, 8));
    }
  }
  const LowFrequencies low = choose_drop_order(powers, sigmas);
  PlaneNoiseOptions options;
  options.drop_order = low.drop_order;
  options.max_lag_px = choose_max_lag(pixels, side);

  const std::size_t count = planes.train.size() + planes.test.size();
  std::vector<std::optional<CaptureNoise>> results(count);
  std::mutex mutex;
  Progress progress("measuring noise", static_cast<std::int64_t>(count));
  parallel_for(static_cast<int>(count), [&](int i) {
    const std::size_t k = static_cast<std::size_t>(i);
    const FirstLook& look = k < planes.train.size() ? planes.train[k] : planes.test[k - planes.train.size()];
    const CaptureReader reader = planes.set.capture(look.key);
    const FrameStream frames = [&](const FrameSink& sink) {
      for (int n = 0; n < reader.size(); ++n) {
        std::optional<Frame> frame;
        try {
          frame = reader.frame(n);
        } catch (const Error& error) {
          // A broken frame leaves the others usable.
          const std::lock_guard lock(mutex);
          planes.notes.push_back(std::string("left out: ") + error.what());
          continue;
        }
        sink(*frame, n);
      }
    };
    try {
      results[k] = measure_noise(look, frames, planes.set.info().region_masks, options);
    } catch (const Error& error) {
      const std::lock_guard lock(mutex);
      planes.notes.push_back(std::string("left out: ") + error.what());
    }
    progress.advance();
  });
  for (std::size_t k = 0; k < count; ++k)
    if (results[k]) (k < planes.train.size() ? train : test).push_back(*results[k]);
  if (train.empty()) {
    std::string all;
    for (const auto& note : planes.notes) all += "\n  " + note;
    throw Error("no plane capture could be measured" + all);
  }
  return low;
}

}  // namespace binrig
