#include "sim/bop_extras.h"

#include <cmath>
#include <cstring>
#include <filesystem>
#include <map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "core/recording_writer.h"

namespace binrig {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {
constexpr double target_visibility = 0.1;  // as bop_toolkit's own lists

void make_folder(const std::string& path) {
  std::error_code code;
  fs::create_directories(path, code);
  if (code) throw Error("cannot make the folder " + path + ": " + code.message());
}

// Corner normals weighted by angle, as in BOP's models.
std::vector<Eigen::Vector3f> vertex_normals(const Mesh& mesh) {
  std::vector<Eigen::Vector3f> normals(mesh.vertices.size(), Eigen::Vector3f::Zero());
  for (const auto& t : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Eigen::Vector3f &corner = mesh.vertices[t[k]], to_next = mesh.vertices[t[(k + 1) % 3]] - corner,
                            to_last = mesh.vertices[t[(k + 2) % 3]] - corner;
      const Eigen::Vector3f across = to_next.cross(to_last);
      normals[t[k]] += across.normalized() * std::atan2(across.norm(), to_next.dot(to_last));
    }
  }
  for (auto& n : normals) n = n.norm() > 0 ? Eigen::Vector3f(n.normalized()) : Eigen::Vector3f(0, 0, 1);
  return normals;
}

std::string ply_of(const Mesh& mesh) {
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\n"
      "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
      mesh.vertices.size(), mesh.triangles.size());
  const auto normals = vertex_normals(mesh);
  for (std::size_t i = 0; i < normals.size(); ++i) {
    bytes.append(reinterpret_cast<const char*>(mesh.vertices[i].data()), 12);
    bytes.append(reinterpret_cast<const char*>(normals[i].data()), 12);
  }
  for (const auto& t : mesh.triangles) {
    bytes.push_back(3);
    bytes.append(reinterpret_cast<const char*>(t.data()), 12);
  }
  return bytes;
}

// Single precision and turns by cos and sin leave dust behind the digits that mean something.
double clean(double value) { return std::round(value * 1e9) / 1e9 + 0.0; }
double clean(float value) { return std::round(value * 1e5) / 1e5 + 0.0; }

json model_entry(const WorldPart& part) {
  const Mesh& mesh = *part.model.mesh;
  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  json entry = {{"diameter", clean(diameter_mm(mesh))},
                {"min_x", clean(low.x())},
                {"min_y", clean(low.y())},
                {"min_z", clean(low.z())},
                {"size_x", clean(high.x() - low.x())},
                {"size_y", clean(high.y() - low.y())},
                {"size_z", clean(high.z() - low.z())},
                {"name", part.model.name}};
  const Surface& surface = mesh.surfaces.front();
  entry["albedo"] = clean(surface.albedo);
  entry["specular"] = clean(surface.specular);
  entry["shininess"] = clean(surface.shininess);
  if (!part.model.symmetries.discrete.empty()) {
    json list = json::array();
    for (const Pose& X : part.model.symmetries.discrete) {
      json rows = json::array();
      for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) rows.push_back(clean(X.matrix()(r, c)));
      }
      list.push_back(rows);
    }
    entry["symmetries_discrete"] = list;
  }
  if (!part.model.symmetries.continuous.empty()) {
    json list = json::array();
    for (const auto& axis : part.model.symmetries.continuous) {
      list.push_back({{"axis", {axis.direction.x(), axis.direction.y(), axis.direction.z()}},
                      {"offset", {axis.offset_mm.x(), axis.offset_mm.y(), axis.offset_mm.z()}}});
    }
    entry["symmetries_continuous"] = list;
  }
  return entry;
}

// BOP's width and height are the last pixel minus the first one; -1 for an object that is not seen at all.
json box_entry(const cv::Rect& box, const Visibility2d& v) {
  if (v.pixels_visible == 0) return {-1, -1, -1, -1};
  return {box.x, box.y, box.width - 1, box.height - 1};
}

// The silhouette beyond the image's border, too, as BOP counts it: in an image of three times the size.
void count_beyond_border(const Renderer& renderer, const RenderScene& alone, RenderRequest request,
                         Visibility2d& info) {
  Camera& camera = request.camera;
  const int width = camera.width, height = camera.height;
  camera.cx += width;
  camera.cy += height;
  camera.width *= 3;
  camera.height *= 3;
  const cv::Mat whole = renderer.render(alone, request)->instance > 0;
  info.pixels_all = cv::countNonZero(whole);
  info.box_all = cv::boundingRect(whole) - cv::Point(width, height);
}
}  // namespace

void write_bop_models(const World& world, const std::string& set_folder) {
  json info = json::object();
  for (std::size_t i = 0; i < world.parts.size(); ++i) info[std::to_string(i + 1)] = model_entry(world.parts[i]);
  // BOP's evaluation reads models_eval, everything else models.
  for (const std::string& folder : {set_folder + "/models", set_folder + "/models_eval"}) {
    make_folder(folder);
    for (std::size_t i = 0; i < world.parts.size(); ++i) {
      write_file_atomically(fmt::format("{}/obj_{:06}.ply", folder, i + 1), ply_of(*world.parts[i].model.mesh));
    }
    write_file_atomically(folder + "/models_info.json", info.dump(1) + "\n");
  }
}

ObjectMasks object_masks(const Renderer& renderer, const RenderScene& scene, const RenderRequest& request,
                         std::size_t parts, const cv::Mat& ids, const cv::Mat& depth_mm) {
  ObjectMasks out;
  RenderRequest alone_request = request;
  alone_request.wanted = static_cast<ChannelSet>(Channel::instance);
  const cv::Mat valid = depth_mm > 0.f;
  for (std::size_t i = 0; i < parts; ++i) {
    RenderScene alone;
    alone.objects = {scene.objects[i]};
    const cv::Mat whole = renderer.render(alone, alone_request)->instance > 0;
    const cv::Mat visible = ids == static_cast<int>(i + 1);
    Visibility2d info;
    info.pixels_all = cv::countNonZero(whole);
    info.pixels_valid = cv::countNonZero(whole & valid);
    info.pixels_visible = cv::countNonZero(visible);
    if (info.pixels_all > 0) info.box_all = cv::boundingRect(whole);
    if (info.pixels_visible > 0) info.box_visible = cv::boundingRect(visible);
    const cv::Rect inner(1, 1, whole.cols - 2, whole.rows - 2);
    // Where the lens bends rays, the camera says nothing of what lies beyond its border.
    if (info.pixels_all > 0 && (info.box_all & inner) != info.box_all && !request.camera.distorted()) {
      count_beyond_border(renderer, alone, alone_request, info);
    }
    out.whole.push_back(whole);
    out.info.push_back(info);
  }
  return out;
}

void BopExtras::begin_capture(const std::string& folder, int scene_id) {
  folder_ = set_ + "/" + folder;
  scene_id_ = scene_id;
  info_text_.clear();
  make_folder(folder_ + "/mask");
}

void BopExtras::add(int frame_id, const ObjectMasks& masks, const std::vector<int>& obj_ids) {
  json entries = json::array();
  std::map<int, int> counts;
  for (std::size_t i = 0; i < masks.info.size(); ++i) {
    const Visibility2d& v = masks.info[i];
    entries.push_back({{"bbox_obj", box_entry(v.box_all, v)},
                       {"bbox_visib", box_entry(v.box_visible, v)},
                       {"px_count_all", v.pixels_all},
                       {"px_count_valid", v.pixels_valid},
                       {"px_count_visib", v.pixels_visible},
                       {"visib_fract", v.visible_share()}});
    if (v.visible_share() >= target_visibility) ++counts[obj_ids[i]];
    std::vector<unsigned char> png;
    cv::imencode(".png", masks.whole[i], png, {cv::IMWRITE_PNG_COMPRESSION, 1});
    write_file_atomically(fmt::format("{}/mask/{:06}_{:06}.png", folder_, frame_id, i), png.data(), png.size());
  }
  info_text_ += fmt::format("{}\n \"{}\": {}", info_text_.empty() ? "" : ",", frame_id, entries.dump());
  for (const auto& [obj_id, count] : counts) targets_.push_back({scene_id_, frame_id, obj_id, count});
}

void BopExtras::finish_capture() { write_file_atomically(folder_ + "/scene_gt_info.json", "{" + info_text_ + "\n}\n"); }

void BopExtras::write_targets() const {
  json list = json::array();
  for (const Target& t : targets_) {
    list.push_back({{"im_id", t.frame_id}, {"inst_count", t.count}, {"obj_id", t.obj_id}, {"scene_id", t.scene_id}});
  }
  write_file_atomically(set_ + "/test_targets_bop19.json", list.dump(1) + "\n");
}

}  // namespace binrig
