#include "app/effects_doc.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/recording_writer.h"
#include "report/colours.h"
#include "sim/part_models.h"
#include "sim/renderer.h"
#include "sim/sensor.h"

namespace binrig {
namespace {

constexpr int frames = 5;
constexpr double frame_period_s = 0.1;

Camera gallery_camera() { return camera_from_field_of_view(240, 180, 0.46); }
const Vector3 gallery_projector(80, 0, 0);

/// A plane tilted by 25 degrees with three patches of other albedo.
RenderScene plane_scene() {
  RenderScene scene;
  const double tilt = 0.44;
  ScenePlane plane;
  plane.normal = Vector3(std::sin(tilt), 0, -std::cos(tilt));
  plane.offset_mm = plane.normal.z() * 800;
  scene.plane = plane;
  const float albedos[] = {0.04f, 0.15f, 0.95f};
  for (int i = 0; i < 3; ++i) {
    Surface surface;
    surface.albedo = albedos[i];
    SceneObject patch;
    patch.mesh = rectangle_mesh(60, 60, surface);
    // Turned with the plane and 0.02 mm in front of it.
    patch.X_CO = Pose(Eigen::AngleAxisd(-tilt, Vector3::UnitY()));
    patch.X_CO.translation() =
        Vector3(0, 0, 800) + patch.X_CO.linear() * Vector3(-100 + 100 * i, 90, 0) + 0.02 * plane.normal;
    scene.objects.push_back(patch);
  }
  return scene;
}

/// A bin with a hand-placed pile, moved by `shift_mm`.
RenderScene bin_scene(const Vector3& shift_mm) {
  RenderScene scene;
  ScenePlane floor;
  floor.offset_mm = -860;
  floor.surface.albedo = 0.35f;
  scene.plane = floor;
  const auto add = [&](std::shared_ptr<const Mesh> mesh, const Vector3& place, const Vector3& turn) {
    SceneObject object;
    object.mesh = std::move(mesh);
    object.X_CO = Pose::Identity();
    if (turn.norm() > 0) object.X_CO.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    object.X_CO.translation() = place + shift_mm;
    scene.objects.push_back(object);
  };
  Surface wall;
  wall.albedo = 0.25f;
  add(box_mesh({330, 8, 90}, wall), {0, -116, 815}, Vector3::Zero());
  add(box_mesh({330, 8, 90}, wall), {0, 116, 815}, Vector3::Zero());
  add(box_mesh({8, 230, 90}, wall), {-161, 0, 815}, Vector3::Zero());
  add(box_mesh({8, 230, 90}, wall), {161, 0, 815}, Vector3::Zero());
  Surface steel, matt, black;
  steel.albedo = 0.3f;
  steel.specular = 0.9f;
  steel.shininess = 25;
  matt.albedo = 0.6f;
  black.albedo = 0.05f;
  add(part_model("cylinder", steel).mesh, {-110, -60, 842}, {0, 1.57, 0});
  add(part_model("cylinder", steel).mesh, {-50, 20, 838}, {1.1, 0.9, 0.2});
  add(part_model("bracket", matt).mesh, {-90, 65, 838}, {0.3, 0.2, 0.8});
  add(part_model("bracket", matt).mesh, {30, -60, 832}, {2.2, 0.3, 0.5});
  add(part_model("wrench", steel).mesh, {100, -40, 846}, {0.1, 0.15, 1.1});
  add(part_model("socket", steel).mesh, {95, 45, 836}, {0.5, 0.4, 0});
  add(part_model("box", black).mesh, {30, 55, 838}, {0.2, 0.5, 0.3});
  add(part_model("sphere", steel).mesh, {5, 5, 810}, Vector3::Zero());
  return scene;
}

using SceneAt = std::function<RenderScene(double time_s)>;

EffectInstance initial_instance(const EffectDeclaration& effect) {
  EffectInstance instance;
  instance.effect = instance.id = effect.name;
  for (const ParameterSpec& spec : effect.parameters) instance.values[spec.name].value = spec.initial;
  return instance;
}

EffectInstance strong_instance(const EffectDeclaration& effect) {
  if (effect.user_defined) {
    return parse_sensor_model("effects:\n  - " + effect.name +
                                  ": {on: disparity, expression: \"a*sin(9*x)*cos(9*y)\", "
                                  "parameters: {a: 0.3}}\n",
                              "example", effect_catalogue())
        .effects.at(0);
  }
  EffectInstance instance = initial_instance(effect);
  instance.values.at(effect.amplitude).value = strength_value(effect, Strength::strong);
  return instance;
}

/// The noise that stands beside an effect: none, but where it is noise that the effect acts on.
EffectInstance base_noise(const EffectDeclaration& beside) {
  const bool acts_on_noise =
      beside.stage == Stage::amplitude || beside.stage == Stage::spatial || beside.stage == Stage::temporal;
  EffectInstance instance = initial_instance(*effect_catalogue().find("spectral_noise"));
  instance.id = "base_noise";
  instance.values.at("sigma").value = acts_on_noise ? 0.5 : 0;
  return instance;
}

struct Shot {
  Frame frame;
  std::shared_ptr<const Channels> channels;
};

/// The frame that shows the effect: the first one after power-on for a drift, else the last of a short series.
Shot shoot(const std::vector<EffectInstance>& instances, const Renderer& renderer, const SceneAt& scene_at, bool motion,
           int shown) {
  SensorModel model;
  model.effects = instances;
  std::stable_sort(model.effects.begin(), model.effects.end(), [](const EffectInstance& a, const EffectInstance& b) {
    return a.declaration(effect_catalogue()).stage < b.declaration(effect_catalogue()).stage;
  });
  check_sensor_model(model, effect_catalogue());
  RenderRequest request;
  request.camera = gallery_camera();
  request.projector_xyz_mm = gallery_projector;
  request.reference_distance_mm = 800;
  request.wanted = SensorRun::needed_channels(model, false) | Channel::cos_incidence | Channel::normal;

  CaptureContext context;
  context.camera = request.camera;
  context.projector_xyz_mm = gallery_projector;
  context.reference_distance_mm = 800;
  context.depth_scale_mm = 0.02;
  context.frames = frames;
  context.power_on = true;
  context.motion = motion;
  context.seed = 4;
  context.render = [&](const View& view, int frame) {
    RenderRequest other = request;
    other.camera = view.camera;
    if (view.projector_xyz_mm) other.projector_xyz_mm = view.projector_xyz_mm;
    other.wanted = view.wanted;
    return renderer.render(scene_at(view.time_s.value_or(frame_period_s * frame)), other);
  };
  SensorRun run(model, context);
  Shot shot;
  for (int i = 0; i <= shown; ++i) {
    const double time_s = frame_period_s * i;
    shot.channels = renderer.render(scene_at(time_s), request);
    shot.frame = run.frame(*shot.channels, {i, time_s, time_s});
  }
  return shot;
}

cv::Vec3b rgb(const Rgb& colour) { return {colour[0], colour[1], colour[2]}; }

/// Depth error on a diverging scale of +-limit, invalid pixels in the colour of their reason.
cv::Mat error_picture(const Shot& shot, double limit) {
  cv::Mat picture(shot.frame.depth_mm.size(), CV_8UC3);
  for (int row = 0; row < picture.rows; ++row) {
    for (int col = 0; col < picture.cols; ++col) {
      const int reason = shot.frame.reason.at<std::uint8_t>(row, col);
      const double error = shot.frame.depth_mm.at<float>(row, col) - shot.channels->depth_mm.at<float>(row, col);
      // 17 levels are enough to the eye and keep the file small; zero is one of them.
      const double share = std::clamp(std::round(8 * error / limit) / 8, -1.0, 1.0);
      const int level = static_cast<int>(std::lround(127.5 + 127.5 * share));
      picture.at<cv::Vec3b>(row, col) =
          reason ? rgb(reason_categories()[reason].colour) : rgb(scale_colours(ColourScale::diverging)[level]);
    }
  }
  return picture;
}

/// The measured surface under a lamp from the upper left, as a viewer of point clouds shows it.
cv::Mat relief_picture(const Shot& shot) {
  const cv::Mat& z = shot.frame.depth_mm;
  const Camera& camera = shot.frame.camera;
  cv::Mat picture(z.size(), CV_8UC3);
  for (int row = 0; row < z.rows; ++row) {
    for (int col = 0; col < z.cols; ++col) {
      const int reason = shot.frame.reason.at<std::uint8_t>(row, col);
      if (reason) {
        picture.at<cv::Vec3b>(row, col) = rgb(reason_categories()[reason].colour);
        continue;
      }
      const auto step = [&](int dy, int dx) {  // mm from here to the neighbour, 0 where it is invalid
        const int y = std::clamp(row + dy, 0, z.rows - 1), x = std::clamp(col + dx, 0, z.cols - 1);
        return shot.frame.reason.at<std::uint8_t>(y, x) ? 0.f : z.at<float>(y, x) - z.at<float>(row, col);
      };
      const double pixel_mm = z.at<float>(row, col) / camera.fx;
      Vector3 normal(0.5 * (step(0, 1) - step(0, -1)) / pixel_mm, 0.5 * (step(1, 0) - step(-1, 0)) / pixel_mm, -1);
      normal.normalize();
      const double light = std::max(0.0, normal.dot(Vector3(-0.45, -0.45, -0.77)));
      const int grey = static_cast<int>(40 + 200 * light) / 12 * 12;
      picture.at<cv::Vec3b>(row, col) = cv::Vec3b(grey, grey, grey);
    }
  }
  return picture;
}

/// Scale of the plane's error pictures: what 98 % of its pixels stay within, rounded up to 1, 2 or 5.
double error_limit(const Shot& shot) {
  std::vector<float> errors;
  for (int row = 0; row < shot.frame.depth_mm.rows; ++row) {
    for (int col = 0; col < shot.frame.depth_mm.cols; ++col) {
      if (shot.frame.reason.at<std::uint8_t>(row, col)) continue;
      errors.push_back(std::abs(shot.frame.depth_mm.at<float>(row, col) - shot.channels->depth_mm.at<float>(row, col)));
    }
  }
  if (errors.empty()) return 1;
  const auto place = errors.begin() + static_cast<std::ptrdiff_t>(0.98 * (errors.size() - 1));
  std::nth_element(errors.begin(), place, errors.end());
  const double value = std::max<double>(*place, 0.2), decade = std::pow(10, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0}) {
    if (value <= step * decade) return step * decade;
  }
  return 10 * decade;
}

/// What the colours of the error pictures mean, mm.
struct Limits {
  double plane_mm, bin_mm;
};

/// Six panels: the plane's error, the bin's error, the bin in relief; left without the effect, right with it.
Limits write_picture(const EffectDeclaration& effect, const Renderer& renderer, const std::string& path) {
  const bool motion = effect.needs.motion || effect.stage == Stage::temporal;
  const int shown = effect.needs.power_on ? 0 : effect.name == "frame_repeat" ? 1 : frames - 1;
  const double speed = motion ? 120 : 0;  // mm/s
  const SceneAt plane = [](double) { return plane_scene(); };
  const SceneAt bin = [speed](double time_s) { return bin_scene(Vector3(speed * time_s, 0, 0)); };
  const EffectInstance noise = base_noise(effect);
  std::vector<EffectInstance> without{noise}, with{noise, strong_instance(effect)};
  if (effect.name == "spectral_noise") with = {strong_instance(effect)};
  if (effect.may_clear && effect.stage == Stage::spatial) {  // fills holes: there must be some
    const EffectInstance shadow = initial_instance(*effect_catalogue().find("projector_shadow"));
    without.insert(without.begin(), shadow);
    with.insert(with.begin(), shadow);
  }
  if (effect.name == "frame_repeat") with.back().values.at("probability").value = 1;
  const Shot plane_without = shoot(without, renderer, plane, motion, shown);
  const Shot plane_with = shoot(with, renderer, plane, motion, shown);
  const Shot bin_without = shoot(without, renderer, bin, motion, shown);
  const Shot bin_with = shoot(with, renderer, bin, motion, shown);
  const Limits limits{error_limit(plane_with), error_limit(bin_with)};
  cv::Mat rows[3], all;
  cv::hconcat(error_picture(plane_without, limits.plane_mm), error_picture(plane_with, limits.plane_mm), rows[0]);
  cv::hconcat(error_picture(bin_without, limits.bin_mm), error_picture(bin_with, limits.bin_mm), rows[1]);
  cv::hconcat(relief_picture(bin_without), relief_picture(bin_with), rows[2]);
  cv::vconcat(rows, 3, all);
  for (const int border : {all.rows / 3, 2 * all.rows / 3}) all.row(border).setTo(cv::Scalar(120, 120, 120));
  all.col(all.cols / 2).setTo(cv::Scalar(120, 120, 120));
  cv::cvtColor(all, all, cv::COLOR_RGB2BGR);
  std::vector<std::uint8_t> png;
  cv::imencode(".png", all, png, {cv::IMWRITE_PNG_COMPRESSION, 9});
  write_file_atomically(path, png.data(), png.size());
  return limits;
}

std::string parameter_row(const ParameterSpec& spec, const EffectDeclaration& effect) {
  const std::string sign = spec.either_sign ? "±" : "";
  return fmt::format("| `{}`{} | {} | {}{} .. {} | {} .. {} | {} | {} |\n", spec.name,
                     spec.name == effect.amplitude ? " *" : "", spec.unit, sign, number_text(spec.typical_low),
                     number_text(spec.typical_high), number_text(spec.lower), number_text(spec.upper),
                     spec.neutral ? number_text(*spec.neutral) : "", spec.meaning);
}

std::string section(const EffectDeclaration& effect, const Limits& limits) {
  std::string text = fmt::format("### {}\n\n{}\n\n", effect.name, effect.phenomenon);
  text += fmt::format("    {}\n\n", effect.formula);
  text += fmt::format(
      "![{0}: a plane and a bin, without and with it](effects/{0}.png)\n\nColours: the plane ±{1} mm, the bin ±{2} "
      "mm.\n\n",
      effect.name, number_text(limits.plane_mm), number_text(limits.bin_mm));
  if (!effect.parameters.empty()) {
    text += "| parameter | unit | typical | bounds | absent at | meaning |\n|---|---|---|---|---|---|\n";
    for (const ParameterSpec& spec : effect.parameters) text += parameter_row(spec, effect);
    text += "\n";
  }
  for (const OptionSpec& option : effect.options) {
    text += fmt::format("- `{}`: {}{}\n", option.name, option.meaning,
                        option.choices.empty() ? "" : fmt::format(" ({})", fmt::join(option.choices, ", ")));
  }
  if (!effect.options.empty()) text += "\n";
  text += fmt::format("- Revealed by: {}.\n", effect.revealed_by);
  if (effect.reason)
    text += fmt::format("- Reason of the pixels that it makes invalid: `{}`.\n", reason_name(*effect.reason));
  if (const auto needs = effect.needs.words(); !needs.empty())
    text += fmt::format("- Needs: {}.\n", fmt::join(needs, ", "));
  if (effect.per_unit_map) text += "- Draws a map that belongs to the unit (`unit_seed`).\n";
  if (effect.per_capture_map) text += "- Draws a map in each capture, which stays through it.\n";
  if (effect.may_clear) text += "- May make an invalid pixel valid again.\n";
  text += fmt::format("- Source: {}.\n", effect.citation);
  if (!effect.deviation.empty()) text += fmt::format("- We deviate: {}.\n", effect.deviation);
  return text + "\n";
}

}  // namespace

void write_effects_page(const std::string& folder) {
  std::error_code failed;
  std::filesystem::create_directories(folder + "/effects", failed);
  if (failed) throw Error("cannot create " + folder + "/effects: " + failed.message());
  const auto renderer = make_renderer("auto");
  std::string text =
      "# Effects\n\n"
      "Written by `binrig effects --markdown docs` from the effects' declarations.\n\n"
      "A sensor model lists effects; they act on the perfect depth of a scene in the order of their stages, and inside "
      "a "
      "stage in the order of the model file. A file that orders them against the stages is refused.\n\n"
      "Each picture has three rows: the depth error of a plane 800 mm away, tilted by 25 degrees, with three patches "
      "of "
      "other albedo (blue too near, red too far); the depth error of a bin; the same bin under a lamp, as a viewer of "
      "point clouds shows it. Left without the effect, right with it at the strong end of its typical range. Invalid "
      "pixels have the colour of their reason. Effects that act on noise have noise beside them; temporal ones are "
      "shown "
      "on a bin that moves to the right.\n\n"
      "In the tables `*` marks the parameter that says how strong the effect is; *absent at* is the value at which it "
      "changes nothing.\n\n";
  std::map<Stage, std::vector<const EffectDeclaration*>> stages;
  for (const EffectDeclaration* effect : effect_catalogue().all()) stages[effect->stage].push_back(effect);
  text += "| stage | effects |\n|---|---|\n";
  for (const auto& [stage, effects] : stages) {
    text += fmt::format("| {} |", stage_name(stage));
    for (const EffectDeclaration* effect : effects) text += fmt::format(" [{0}](#{0})", effect->name);
    text += " |\n";
  }
  for (const auto& [stage, effects] : stages) {
    text += fmt::format("\n## Stage: {}\n\n", stage_name(stage));
    for (const EffectDeclaration* effect : effects) {
      const Limits limits = write_picture(*effect, *renderer, folder + "/effects/" + effect->name + ".png");
      text += section(*effect, limits);
    }
  }
  write_file_atomically(folder + "/effects.md", text);
}

}  // namespace binrig
