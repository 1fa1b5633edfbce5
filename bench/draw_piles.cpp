// draw_piles FOLDER [SEED]: FOLDER/pile-NAME.jpg for 18 of each built-in part, and for the shipped mixed pile: colour,
// depth and instances, from above and from the side with the front wall taken away. The pictures of docs/stacking.md.
#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "report/colours.h"
#include "sim/renderer.h"
#include "sim/synthetic_source.h"
#include "sim/world.h"

namespace {

using namespace binrig;

constexpr int width = 480, height = 360, finer = 3;

World pile_world(const std::string& part) {
  const std::string folder = std::string(BINRIG_SOURCE_DIR) + "/worlds";
  if (part == "mixed") return read_world(folder + "/mixed-18.yaml");
  return parse_world(fmt::format(R"(name: {0}-18
parts:
  - {{part: {0}, count: 18, surfaces: [{{albedo: 0.4, specular: 0.5, shininess: 25, rgb: [0.58, 0.6, 0.64]}}]}}
bins:
  - {{name: bin, surface: {{albedo: 0.35, rgb: [0.3, 0.36, 0.45]}}}}
table: {{height: -4, surface: {{albedo: 0.3, rgb: [0.35, 0.33, 0.3]}}}}
sensors:
  - {{name: above, pose: {{from: [0, 0, 880], at: [0, 0, 0], up: [0, 1, 0]}}}}
lights:
  - {{position: [-250, -250, 1300], intensity: 0.55}}
  - {{position: [300, 200, 1200], intensity: 0.4}}
)",
                                 part),
                     part, folder);
}

// The bin without its front wall.
std::shared_ptr<const Mesh> open_bin_mesh(const WorldBin& bin) {
  const Vector3 size = bin.inner_size_mm;
  const double t = bin.wall_mm;
  Mesh all;
  all.surfaces = {bin.surface};
  const auto add = [&](const Vector3& extent, const Vector3& centre) {
    const auto box = box_mesh(extent, bin.surface);
    const auto first = static_cast<std::uint32_t>(all.vertices.size());
    for (const auto& v : box->vertices) all.vertices.push_back(v + centre.cast<float>());
    for (const auto& tri : box->triangles) all.triangles.push_back({tri[0] + first, tri[1] + first, tri[2] + first});
  };
  add({size.x() + 2 * t, size.y() + 2 * t, t}, {0, 0, -t / 2});
  add({size.x(), t, size.z()}, {0, (size.y() + t) / 2, size.z() / 2});
  for (const double side : {-1.0, 1.0}) {
    add({t, size.y() + 2 * t, size.z()}, {side * (size.x() + t) / 2, 0, size.z() / 2});
  }
  all.content_hash = hash_of(all);
  return std::make_shared<const Mesh>(std::move(all));
}

cv::Mat smaller(const cv::Mat& picture) {
  cv::Mat out;
  cv::resize(picture, out, {width, height}, 0, 0, cv::INTER_AREA);
  return out;
}

// Colour, depth (over the range that the parts take) and instances side by side.
cv::Mat view(const Renderer& renderer, const World& world, const Pose& X_WC, double fov_deg) {
  RenderRequest request;
  request.camera.width = width * finer;
  request.camera.height = height * finer;
  request.camera.fx = request.camera.fy = width * finer / 2.0 / std::tan(fov_deg / 360 * 3.14159265358979);
  request.camera.cx = (width * finer - 1) / 2.0;
  request.camera.cy = (height * finer - 1) / 2.0;
  request.wanted = Channel::depth | Channel::instance | Channel::rgb;
  const auto channels = renderer.render(render_scene(world, X_WC), request);
  cv::Mat depth(channels->depth_mm.size(), CV_8UC3), ids(depth.size(), CV_8UC3);
  const auto parts = static_cast<std::uint16_t>(world.objects.size());
  double near_mm = 0, far_mm = 0;
  cv::minMaxLoc(channels->depth_mm, &near_mm, &far_mm, nullptr, nullptr,
                (channels->instance > 0) & (channels->instance <= parts));
  const auto& scale = scale_colours(ColourScale::sequential);
  for (int row = 0; row < depth.rows; ++row) {
    for (int col = 0; col < depth.cols; ++col) {
      const double share = (far_mm - channels->depth_mm.at<float>(row, col)) / (far_mm - near_mm);
      const Rgb c = scale[static_cast<std::size_t>(std::clamp(share, 0.0, 1.0) * (scale_steps - 1))];
      depth.at<cv::Vec3b>(row, col) = {c[2], c[1], c[0]};
      const int id = channels->instance.at<std::uint16_t>(row, col);
      const bool part = id > 0 && id <= parts;
      // Hues apart by the golden angle: neighbours in number differ.
      ids.at<cv::Vec3b>(row, col) = part ? cv::Vec3b(static_cast<std::uint8_t>(id * 111 % 180), 190,
                                                     static_cast<std::uint8_t>(id % 2 ? 235 : 170))
                                         : cv::Vec3b(0, 0, 40);
    }
  }
  cv::cvtColor(ids, ids, cv::COLOR_HSV2BGR);
  cv::Mat colour, row;
  cv::cvtColor(channels->rgb, colour, cv::COLOR_RGB2BGR);
  cv::hconcat(std::vector<cv::Mat>{smaller(colour), smaller(depth), smaller(ids)}, row);
  return row;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2 && argc != 3) throw Error("usage: draw_piles FOLDER [SEED]");
  const std::uint64_t seed = argc == 3 ? std::strtoull(argv[2], nullptr, 10) : 1;
  const auto renderer = make_renderer("auto");
  std::vector<std::string> names = part_names();
  names.push_back("mixed");
  for (const std::string& name : names) {
    const WorldProvider provider = world_in_motion(pile_world(name), seed);
    World world = *provider.now();
    const cv::Mat above = view(*renderer, world, look_at({0, 0, 880}, {0, 0, 0}, {0, 1, 0}), 15.8);
    world.bins.front().mesh = open_bin_mesh(world.bins.front());
    const cv::Mat side = view(*renderer, world, look_at({0, -860, 300}, {0, 0, 32}, {0, 0, 1}), 16.5);
    cv::Mat sheet;
    cv::vconcat(above, side, sheet);
    const std::string file = std::string(argv[1]) + "/pile-" + name + "-18.jpg";
    if (!cv::imwrite(file, sheet, {cv::IMWRITE_JPEG_QUALITY, 88})) throw Error("cannot write " + file);
    std::printf("%s: %zu parts\n", file.c_str(), world.objects.size());
  }
} catch (const std::exception& problem) {
  std::fprintf(stderr, "draw_piles: %s\n", problem.what());
  return 2;
}
