#include "app/open.h"

#include <charconv>
#include <filesystem>

#include "core/error.h"
#include "core/uri.h"
#include "hw/replay_source.h"
#include "sim/effect.h"
#include "sim/forward_source.h"
#include "sim/live_world.h"
#include "sim/scene_forward_model.h"
#include "sim/synthetic_source.h"

namespace binrig {
namespace {

std::uint64_t take_number(Uri& uri, const std::string& key, std::uint64_t fallback) {
  const std::string text = uri.take(key).value_or(std::to_string(fallback));
  std::uint64_t value = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc{} || end != text.data() + text.size()) {
    throw Error("the source cannot be opened", {{uri.text, key, text, "", "a whole number", ""}});
  }
  return value;
}

SensorModel model_for(const World& world, std::size_t sensor, const std::string& given) {
  const std::string file = given.empty() ? world.sensors.at(sensor).model_file : given;
  if (file.empty()) throw Error(world.file + ": the sensor has no model: write one there, or add ?model=M.yaml");
  return read_sensor_model(file, effect_catalogue());
}

std::unique_ptr<FrameSource> open_world(Uri uri) {
  const World world = read_world(uri.path);
  SyntheticOptions options;
  options.sensor = static_cast<int>(take_number(uri, "sensor", 0));
  options.seed = take_number(uri, "seed", 1);
  options.with_rgb = take_number(uri, "rgb", 0) != 0;
  const int scenes = static_cast<int>(take_number(uri, "scenes", 1)),
            frames = static_cast<int>(take_number(uri, "frames", 0));
  const std::string model = uri.take("model").value_or("");
  uri.finish({"model", "sensor", "seed", "rgb", "scenes", "frames"});
  if (options.sensor >= static_cast<int>(world.sensors.size())) {
    throw Error("the source cannot be opened", {{uri.text, "sensor", std::to_string(options.sensor), "",
                                                 "0 .. " + std::to_string(world.sensors.size() - 1), ""}});
  }
  const SensorModel sensor = model_for(world, static_cast<std::size_t>(options.sensor), model);
  return make_synthetic_source(uri.text, world_in_motion(world, options.seed), sensor, options, scenes, frames);
}

std::unique_ptr<FrameSource> open_simulated_set(Uri uri) {
  const std::uint64_t seed = take_number(uri, "seed", 1);
  const std::string model_file = uri.take("model").value_or("");
  uri.finish({"model", "seed"});
  if (model_file.empty()) throw Error(uri.text + " needs a sensor model: add ?model=M.yaml");
  const SensorModel model = read_sensor_model(model_file, effect_catalogue());
  const auto forward = std::make_shared<SceneForwardModel>(RecordingSet::open(uri.path));
  std::vector<int> chosen;
  for (std::size_t i = 0; i < forward->captures().size(); ++i) {
    if (uri.fragment == forward->captures()[i].key()) chosen.push_back(static_cast<int>(i));
  }
  if (!uri.fragment.empty() && chosen.empty()) {
    throw Error(uri.text + ": there is no capture " + uri.fragment + " with meshes and poses to simulate");
  }
  return make_forward_source(uri.text, forward, model, chosen, seed);
}

bool is_world(const std::string& path) { return !std::filesystem::is_directory(path); }

Error unknown_scheme(const Uri& uri) {
  std::string known;
  for (const Scheme& scheme : source_schemes()) known += "\n  " + scheme.pattern + "  " + scheme.meaning;
  return Error("no source has the scheme '" + uri.scheme + ":'; known are" + known);
}

}  // namespace

std::vector<Scheme> source_schemes() {
  return {{"replay:SET[#split/id][?rate=real|max&loop=0|1]", "a recording, frame by frame"},
          {"sim:SET?model=M.yaml[&seed=N][#split/id]", "the scenes of a recording with meshes and poses, simulated"},
          {"sim:WORLD.yaml[?model=M.yaml&sensor=N&seed=N&scenes=N&frames=N&rgb=0|1]",
           "a world, simulated (endless unless frames is given)"}};
}

std::unique_ptr<FrameSource> open_source(const std::string& text) {
  const Uri uri = Uri::parse(text);
  if (uri.scheme == "replay") return open_replay(uri);
  if (uri.scheme == "sim") return is_world(uri.path) ? open_world(uri) : open_simulated_set(uri);
  throw unknown_scheme(uri);
}

std::unique_ptr<Bin> open_bin(const std::string& text) {
  Uri uri = Uri::parse(text);
  if (uri.scheme != "sim" || !is_world(uri.path)) throw Error("a bin is sim:WORLD.yaml, not " + text);
  const int bin = static_cast<int>(take_number(uri, "bin", 0));
  const std::uint64_t seed = take_number(uri, "seed", 1);
  uri.finish({"bin", "seed"});
  return make_simulated_bin(std::make_shared<LiveWorld>(read_world(uri.path), seed), bin);
}

Cell open_cell(const std::string& text) {
  Uri uri = Uri::parse(text);
  if (uri.scheme != "sim" || !is_world(uri.path)) throw Error("a cell is sim:WORLD.yaml, not " + text);
  SyntheticOptions options;
  options.seed = take_number(uri, "seed", 1);
  const std::string model = uri.take("model").value_or("");
  uri.finish({"model", "seed"});
  const auto live = std::make_shared<LiveWorld>(read_world(uri.path), options.seed);
  const std::shared_ptr<const World> world = live->now();
  Cell cell;
  for (std::size_t i = 0; i < world->sensors.size(); ++i) {
    options.sensor = static_cast<int>(i);
    WorldProvider provider;
    provider.now = [live] { return live->now(); };
    provider.begin_scene = [](int) {};  // the pile of a cell changes by what its bins do, not by who looks at it
    cell.sources.push_back(make_synthetic_source(text, provider, model_for(*world, i, model), options, 1, 0));
  }
  for (int i = 0; i < live->bins(); ++i) cell.bins.push_back(make_simulated_bin(live, i));
  return cell;
}

}  // namespace binrig
