// binrig compare: measured frames beside simulated ones, in a report.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <set>

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "app/commands.h"
#include "app/forward.h"
#include "calib/plane_fit.h"
#include "compare/fidelity_report.h"
#include "compare/scene_report.h"
#include "core/error.h"
#include "core/parallel.h"
#include "core/progress.h"
#include "core/recording_writer.h"
#include "core/yaml.h"
#include "sim/effect.h"

namespace binrig {
namespace {

struct CompareOptions {
  std::string measured, model, simulated, out, require;
  std::vector<std::string> captures;
  int detailed = 3;
  CommonOptions common;
};

FrameStream stream_of(const CaptureReader& capture) {
  return [capture](const FrameSink& sink) {
    for (int i = 0; i < capture.size(); ++i) sink(capture.frame(i), i);
  };
}

/// What the comparison simulates with; either a model over the measured set's captures or another set.
struct Simulated {
  Forward forward;
  SensorModel model;
  std::optional<RecordingSet> set;
  std::uint64_t seed = 1;

  int index(const std::string& key) const {
    const auto& all = forward.model->captures();
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (all[i].key() == key) return static_cast<int>(i);
    }
    return -1;
  }
  FrameStream stream(const std::string& key) const {
    if (set) return stream_of(set->capture(key));
    const int capture = index(key);
    return [this, capture](const FrameSink& sink) {
      SimulationRequest request;
      request.capture = capture;
      request.model = &model;
      request.seed = seed;
      forward.model->simulate(request, sink);
    };
  }
};

PlaneCapture measured_plane(const RecordingSet& set, const CaptureReader& capture, const Simulated& simulated,
                            const std::string& key) {
  PlaneCapture out;
  const Frame first = capture.frame(0);
  out.name = key + (capture.info().name.empty() ? "" : " " + capture.info().name);
  out.camera = first.camera;
  out.frames = stream_of(capture);
  if (const auto projector = set.info().sensor.projector())
    out.focal_baseline_px_mm = out.camera.fx * std::abs(projector->x());
  const PixelRays rays(out.camera);
  cv::Mat region = set.info().region_masks ? set.region(capture.info()) : cv::Mat();
  const Frame header = capture.header(0);
  cv::Mat surface = first.depth_mm;
  if (simulated.forward.model && simulated.index(key) >= 0) {
    const auto perfect = simulated.forward.model->perfect(simulated.index(key), 0, Offset{},
                                                          static_cast<ChannelSet>(Channel::depth), simulated.model);
    const bool posed = header.objects && !header.objects->empty() && !set.models().empty();
    out.target.independent = posed && !set.info().poses_fitted_to_this_depth;
    if (region.empty() && posed) {
      // Three pixels inside the target's rim, where neither flying pixels nor a pose error of a pixel matter.
      cv::erode(perfect->depth_mm > 0, region, cv::Mat::ones(7, 7, CV_8U));
    }
    if (region.empty()) region = fit_plane(first.depth_mm, rays).region;
    surface = perfect->depth_mm;
  }
  PlaneFit fit;
  try {
    fit = fit_plane(surface, rays, region);
  } catch (const Error& error) {
    throw Error(key + ": " + error.what());
  }
  out.target.normal = fit.normal;
  out.target.offset_mm = fit.offset_mm;
  out.target.region = fit.region;
  return out;
}

std::map<std::string, double> read_limits(const std::string& path) {
  Violations violations;
  YamlMap map(load_yaml_file(path), path, "", violations);
  std::map<std::string, double> limits;
  for (const auto& key : map.keys()) {
    if (const auto value = map.number(key, 0, 1e9, "")) limits[key] = *value;
  }
  map.finish();
  violations.throw_if_any("limits cannot be read");
  if (limits.empty()) throw Error(path + " holds no limit");
  return limits;
}

std::vector<CaptureFidelity> compare_planes(const RecordingSet& set, const Simulated& simulated,
                                            const std::vector<CaptureInfo>& planes) {
  std::vector<CaptureFidelity> results(planes.size());
  Progress progress("comparing planes", static_cast<std::int64_t>(planes.size()));
  parallel_for(static_cast<int>(planes.size()), [&](int i) {
    const std::string key = planes[i].key();
    const CaptureReader capture = set.capture(key);
    const PlaneCapture measured = measured_plane(set, capture, simulated, key);
    PlaneCapture other = measured;
    other.name += ", as simulated";
    other.frames = simulated.stream(key);
    results[i] = compare_profiles(noise_profile(measured), noise_profile(other), key, planes[i].split == "test");
    progress.advance();
  });
  return results;
}

/// The model's steps: nothing but geometry, each effect that takes pixels away alone, and everything.
std::vector<SensorModel> mask_models(const SensorModel& whole, const ForwardModel& forward,
                                     std::vector<std::string>& names) {
  SensorModel perfect = whole;
  perfect.effects.clear();
  std::set<std::string> inactive;
  for (const auto& [id, why] : forward.inactive(whole)) inactive.insert(id);
  std::vector<SensorModel> models{perfect};
  names = {"perfect depth"};
  for (const auto& instance : whole.effects) {
    if (!instance.declaration(forward.catalogue()).reason || inactive.contains(instance.id)) continue;
    models.push_back(perfect);
    models.back().effects = {instance};
    names.push_back(instance.id + " alone");
  }
  models.push_back(whole);
  names.push_back("the whole model");
  return models;
}

std::vector<SceneFidelity> compare_scenes(const RecordingSet& set, const Simulated& simulated,
                                          const std::vector<CaptureInfo>& scenes) {
  std::vector<SceneFidelity> results(scenes.size());
  if (scenes.empty()) return results;
  const ForwardModel& forward = *simulated.forward.model;
  std::vector<std::string> names{"the simulated set"};
  std::vector<SensorModel> models;
  if (!simulated.set) models = mask_models(simulated.model, forward, names);
  constexpr ChannelSet wanted = Channel::depth | Channel::normal | Channel::edge_distance;
  Progress progress("comparing scenes", static_cast<std::int64_t>(scenes.size()));
  parallel_for(static_cast<int>(scenes.size()), [&](int i) {
    const std::string key = scenes[i].key();
    const CaptureReader capture = set.capture(key);
    const int index = simulated.index(key);
    const auto perfect = [&](int frame) { return forward.perfect(index, frame, Offset{}, wanted, simulated.model); };
    SceneComparison comparison(key, names, set.info().valid_region);
    for (int f = 0; f < capture.size(); ++f) comparison.add_measured(capture.frame(f), *perfect(f));
    if (simulated.set) {
      const CaptureReader other = simulated.set->capture(key);
      for (int f = 0; f < std::min(capture.size(), other.size()); ++f)
        comparison.add_simulated(0, other.frame(f), capture.frame(f), *perfect(f));
    }
    for (std::size_t m = 0; m < models.size(); ++m) {
      SimulationRequest request;
      request.capture = index;
      request.model = &models[m];
      request.seed = simulated.seed;
      forward.simulate(request, [&](const Frame& frame, int f) {
        comparison.add_simulated(static_cast<int>(m), frame, capture.frame(f), *perfect(f));
      });
    }
    results[i] = comparison.finish(simulated.seed);
    results[i].name = capture.info().name;
    results[i].held_out = scenes[i].split == "test";
    progress.advance();
  });
  return results;
}

/// How far the median depth of a scene may be off: three times what is known of the poses, and never less than 0.1 %.
std::optional<double> offset_tolerance(const SetInfo& info) {
  if (info.poses_fitted_to_this_depth || !info.pose_sigma_mm) return std::nullopt;
  return std::max(0.5, 3 * *info.pose_sigma_mm);
}

int compare(const CompareOptions& options) {
  apply(options.common);
  const RecordingSet set = RecordingSet::open(options.measured);
  std::map<std::string, double> limits;
  if (!options.require.empty()) limits = read_limits(options.require);
  for (const auto& key : options.captures) set.capture(key);  // throws, listing those there are

  Simulated simulated;
  simulated.seed = options.common.seed;
  std::vector<std::string> notes;
  ForwardOptions forward;
  forward.captures = options.captures;
  if (!options.simulated.empty()) {
    simulated.set = RecordingSet::open(options.simulated);
    simulated.model = parse_sensor_model("name: perfect\n", "perfect", effect_catalogue());
    try {
      simulated.forward = open_forward_model(options.measured, forward);
    } catch (const Error&) {
      notes.push_back("The recording has no geometry that could be rendered: masks are not compared.");
    }
  } else {
    simulated.model = read_sensor_model(options.model, effect_catalogue());
    simulated.forward = open_forward_model(options.measured, forward);
    const std::string projector = settle_projector(simulated.model, *simulated.forward.model);
    if (!projector.empty()) notes.push_back(projector);
    for (const auto& [id, why] : simulated.forward.model->inactive(simulated.model))
      notes.push_back(id + " does not act here: " + why);
  }
  notes.insert(notes.end(), simulated.forward.notes.begin(), simulated.forward.notes.end());

  std::vector<CaptureInfo> planes, scenes;
  for (const CaptureInfo& info : set.captures()) {
    if (!options.captures.empty() &&
        std::find(options.captures.begin(), options.captures.end(), info.key()) == options.captures.end())
      continue;
    const CaptureReader capture = set.capture(info.key());
    const bool renders = simulated.forward.model && simulated.index(info.key()) >= 0;
    if (!capture.has_depth() || capture.size() == 0) {
      notes.push_back(info.key() + " has no depth and was left out");
    } else if (!renders && (!simulated.set || info.target == TargetKind::scene)) {
      for (int i = 0; i < capture.size(); ++i) capture.frame(i);  // a broken file is an error, not a capture less
      notes.push_back(info.key() + " cannot be simulated and was left out");
    } else {
      (info.target == TargetKind::plane ? planes : scenes).push_back(info);
    }
  }
  if (planes.empty() && scenes.empty())
    throw Error("nothing to compare in " + options.measured + (notes.empty() ? "" : ": " + notes.front()));
  auto plane_results = compare_planes(set, simulated, planes);
  const auto scene_results = compare_scenes(set, simulated, scenes);
  const auto pools = pool_scenes(scene_results, options.common.seed);
  std::vector<Aspect> scene_questions;
  for (const auto& scene : scene_results) {
    const auto aspects = scene_aspects(scene, offset_tolerance(set.info()));
    scene_questions.insert(scene_questions.end(), aspects.begin(), aspects.end());
  }
  const Fidelity fidelity = judge(std::move(plane_results), std::move(scene_questions));
  const auto broken = broken_limits(fidelity, limits);

  const auto file_name = [](const std::string& path) { return std::filesystem::path(path).filename().string(); };
  const std::string name = simulated.set ? file_name(options.simulated) : simulated.model.name;
  nlohmann::json json{
      {"measured", options.measured},      {"simulated", options.simulated.empty() ? options.model : options.simulated},
      {"seed", options.common.seed},       {"notes", notes},
      {"broken_limits", broken},           {"fidelity", fidelity_json(fidelity)},
      {"scenes", nlohmann::json::array()}, {"masks", nlohmann::json::object()}};
  for (const auto& scene : scene_results) json["scenes"].push_back(scene_json(scene));
  for (const auto& pool : pools) {
    for (const auto& score : pool.scores) json["masks"][pool.split].push_back(score_json(score));
  }

  Page page("Fidelity of " + name, "Measured and simulated frames through the same statistics");
  page.fact("measured",
            file_name(options.measured) + (set.info().sensor.name.empty() ? "" : " (" + set.info().sensor.name + ")"));
  page.fact("simulated", simulated.set ? options.simulated : options.model);
  page.fact("captures", fmt::format("{} of planes, {} of scenes", planes.size(), scenes.size()));
  page.fact("seed", std::to_string(options.common.seed));
  draw_verdict(page, fidelity);
  if (!broken.empty())
    page.verdict(Mark::bad, fmt::format("{} of the limits asked for are not kept.", broken.size()), broken);
  const auto held_out = [](const CaptureInfo& c) { return c.split == "test"; };
  if (std::none_of(planes.begin(), planes.end(), held_out) && std::none_of(scenes.begin(), scenes.end(), held_out)) {
    page.note(
        "No test captures are compared here: nothing is held out, so a model fitted to these captures is judged on "
        "what it was "
        "fitted to.");
  }
  draw_fidelity(page, fidelity, options.detailed);
  draw_scenes(page, scene_results, pools, options.detailed);
  if (!notes.empty()) {
    page.section("Notes");
    page.list(notes);
  }
  const std::string path = page.write(options.out);
  write_file_atomically((std::filesystem::path(options.out) / "report.json").string(), json.dump(1));
  if (options.common.json) {
    fmt::print("{}\n", json.dump(1));
  } else {
    fmt::print("{}\n", fidelity.headline);
    for (const auto& reason : fidelity.reasons) fmt::print("  {}\n", reason);
    for (const auto& pool : pools) {
      for (const auto& score : pool.scores) {
        fmt::print(
            "  {}: {}: precision {:.3f}, recall {:.3f}, IoU {:.3f} ({:.3f} .. {:.3f}), unexplained {:.3f} ({:.3f} .. "
            "{:.3f})\n",
            pool.split, score.model, score.precision.value, score.recall.value, score.iou.value, score.iou.low,
            score.iou.high, score.unexplained.value, score.unexplained.low, score.unexplained.high);
      }
    }
    for (const auto& limit : broken) fmt::print("limit not kept: {}\n", limit);
    fmt::print("{}\n", path);
  }
  return broken.empty() ? 0 : 1;
}

}  // namespace

void add_compare(CLI::App& app, int& status) {
  auto options = std::make_shared<CompareOptions>();
  CLI::App* verb = app.add_subcommand("compare", "measured frames beside simulated ones: what agrees, what does not");
  verb->add_option("--measured", options->measured, "the recording set")->required();
  CLI::Option* model = verb->add_option("--model", options->model, "sensor model that simulates the set's captures");
  CLI::Option* other =
      verb->add_option("--simulated", options->simulated, "recording set with the same captures, simulated elsewhere");
  model->excludes(other);
  verb->add_option("--out", options->out, "folder for report.html, its pictures and report.json")->required();
  verb->add_option("--capture", options->captures, "only these captures (train/1)");
  verb->add_option("--require", options->require,
                   "YAML of limits (aspect: largest difference); exit status 1 if one is not kept");
  verb->add_option("--detailed", options->detailed, "how many captures are drawn in full")->check(CLI::Range(0, 1000));
  add_common_options(*verb, options->common);
  verb->callback([options, &status] {
    if (options->model.empty() && options->simulated.empty())
      throw Error("compare needs --model M.yaml or --simulated SET");
    status = compare(*options);
  });
}

}  // namespace binrig
