// Sets that `binrig simulate` writes, read as the BOP toolkit reads them. What is checked is what the toolkit's sources
// ask for (github.com/thodan/bop_toolkit): dataset_params.py (paths), inout.py (load_scene_camera, load_scene_gt,
// load_cam_params, load_depth, load_ply), misc.py (calc_2d_bbox, get_symmetry_transformations), calc_gt_info.py (the
// meaning of every key of scene_gt_info.json) and eval_calc_errors.py (targets, models_eval). The toolkit itself does
// not run here.
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>

#include <fmt/format.h>
#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "tests/support/program.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::read_json;

// The box hides the socket in part, the second socket reaches beyond the left border.
const char* const hidden_and_cut = R"(
parts:
  - {part: box, poses: [{translation: [-20, 0, 40]}]}
  - {part: socket, poses: [{translation: [0, 5, 20]}, {translation: [-112, 0, 20]}]}
  - {part: cylinder, poses: [{translation: [60, 30, 10], rotation_vector_deg: [90, 0, 0]}]}
table: {height: 0}
sensors:
  - name: above
    pose: {from: [0, 0, 800], at: [0, 0, 0]}
    camera: {width: 320, height: 240, horizontal_fov_deg: 16}
    projector: [100, 0, 0]
    range: [700, 900]
)";

class BopFormat : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new test::ScratchFolder;
    std::ofstream(*folder_ / "world.yaml") << hidden_and_cut;
    const test::Run run =
        test::run_binrig("simulate --quiet --world " + (*folder_ / "world.yaml") + " --model " + BINRIG_SOURCE_DIR +
                         "/models/thesis-five.yaml --out " + set() + " --scenes 2 --frames 2");
    ASSERT_EQ(run.status, 0) << run.output;
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  static std::string set() { return *folder_ / "set"; }
  static std::string scene(int id) { return fmt::format("{}/test/{:06}", set(), id); }
  static test::ScratchFolder* folder_;
};
test::ScratchFolder* BopFormat::folder_ = nullptr;

TEST_F(BopFormat, ScenesAreTheFoldersOfTheSplit) {
  std::set<int> ids;
  // get_present_scene_ids: every folder's name is a number.
  for (const auto& entry : fs::directory_iterator(set() + "/test")) {
    if (entry.is_directory()) ids.insert(std::stoi(entry.path().filename()));
  }
  EXPECT_EQ(ids, (std::set<int>{1, 2}));
}

TEST_F(BopFormat, CameraParameters) {
  const json camera = read_json(set() + "/camera.json");
  for (const char* key : {"width", "height", "fx", "fy", "cx", "cy"}) EXPECT_TRUE(camera.at(key).is_number()) << key;
  const json scene_camera = read_json(scene(1) + "/scene_camera.json");
  ASSERT_EQ(scene_camera.size(), 2u);
  for (const auto& [im_id, entry] : scene_camera.items()) {
    EXPECT_NO_THROW(std::stoi(im_id));
    ASSERT_EQ(entry.at("cam_K").size(), 9u);  // row by row
    EXPECT_EQ(entry["cam_K"][0], camera["fx"]);
    EXPECT_EQ(entry["cam_K"][2], camera["cx"]);
    EXPECT_EQ(entry["cam_K"][5], camera["cy"]);
    EXPECT_EQ(entry["cam_K"][8], 1.0);
    EXPECT_EQ(entry.at("depth_scale"), camera["depth_scale"]);
    EXPECT_EQ(entry.at("cam_R_w2c").size(), 9u);
    EXPECT_EQ(entry.at("cam_t_w2c").size(), 3u);
  }
}

TEST_F(BopFormat, PosesProjectTheModelsOntoTheirMasks) {
  const json gt = read_json(scene(1) + "/scene_gt.json"), camera = read_json(scene(1) + "/scene_camera.json");
  const std::vector<int> kinds{1, 2, 2, 3};
  ASSERT_EQ(gt.at("0").size(), kinds.size());
  for (std::size_t k = 0; k < kinds.size(); ++k) {
    const json& entry = gt["0"][k];
    EXPECT_EQ(entry.at("obj_id"), kinds[k]);
    ASSERT_EQ(entry.at("cam_R_m2c").size(), 9u);
    ASSERT_EQ(entry.at("cam_t_m2c").size(), 3u);
    const auto R = entry["cam_R_m2c"].get<std::vector<double>>(), K = camera["0"]["cam_K"].get<std::vector<double>>();
    EXPECT_NEAR(Eigen::Map<const Eigen::Matrix3d>(R.data()).determinant(), 1, 1e-6);
    // The centre of a part lies inside its silhouette, but for the bore of a socket that is seen along its axis: there
    // at its bounding box's centre.
    const auto t = entry["cam_t_m2c"].get<std::vector<double>>();
    EXPECT_GT(t[2], 700);  // millimetres along the viewing direction
    const double u = K[0] * t[0] / t[2] + K[2], v = K[4] * t[1] / t[2] + K[5];
    const auto box = read_json(scene(1) + "/scene_gt_info.json")["0"][k]["bbox_obj"].get<std::vector<int>>();
    // Perspective moves the middle of a part 50 mm high, 60 mm off the axis, by 60 * 25 / 800^2 * fx < 3 px.
    EXPECT_NEAR(u, box[0] + box[2] / 2.0, 3.5) << k;
    EXPECT_NEAR(v, box[1] + box[3] / 2.0, 3.5) << k;
  }
}

TEST_F(BopFormat, ImagesHaveTheTypesThatAreReadAndOneNumber) {
  const json camera = read_json(scene(1) + "/scene_camera.json");
  for (int im_id = 0; im_id < 2; ++im_id) {
    const auto file = [&](const char* kind) { return fmt::format("{}/{}/{:06}.png", scene(1), kind, im_id); };
    const cv::Mat depth = cv::imread(file("depth"), cv::IMREAD_UNCHANGED);
    ASSERT_EQ(depth.type(), CV_16U);
    // The table, 800 mm away: multiplying with depth_scale gives millimetres. 5 mm: the sensor's noise.
    const double scale = camera[std::to_string(im_id)]["depth_scale"];
    EXPECT_NEAR(depth.at<std::uint16_t>(230, 160) * scale, 800, 5);
    EXPECT_EQ(cv::imread(file("rgb"), cv::IMREAD_UNCHANGED).type(), CV_8UC3);
    EXPECT_EQ(cv::imread(file("gray"), cv::IMREAD_UNCHANGED).channels(), 1);
    EXPECT_EQ(cv::imread(file("rgb"), cv::IMREAD_UNCHANGED).size(), depth.size());
  }
}

TEST_F(BopFormat, InfoCountsAsTheToolkitCounts) {
  const json all = read_json(scene(1) + "/scene_gt_info.json");
  ASSERT_EQ(all.at("0").size(), 4u);
  const cv::Mat depth = cv::imread(scene(1) + "/depth/000000.png", cv::IMREAD_UNCHANGED);
  for (int k = 0; k < 4; ++k) {
    const json& info = all["0"][static_cast<std::size_t>(k)];
    const auto mask = [&](const char* kind) {
      return cv::imread(fmt::format("{}/{}/{:06}_{:06}.png", scene(1), kind, 0, k), cv::IMREAD_UNCHANGED);
    };
    const cv::Mat whole = mask("mask"), visible = mask("mask_visib");
    ASSERT_EQ(whole.type(), CV_8U);
    ASSERT_EQ(visible.type(), CV_8U);
    EXPECT_EQ(cv::countNonZero((whole != 0) & (whole != 255)), 0);
    EXPECT_EQ(info.at("px_count_visib"), cv::countNonZero(visible));
    EXPECT_EQ(info.at("px_count_valid"), cv::countNonZero(whole & (depth > 0)));
    const auto all_px = info.at("px_count_all").get<double>();
    EXPECT_NEAR(info.at("visib_fract"), info["px_count_visib"].get<double>() / all_px, 1e-9);
    // calc_2d_bbox: the last pixel minus the first one.
    const cv::Rect seen = cv::boundingRect(visible);
    EXPECT_EQ(info.at("bbox_visib"), json({seen.x, seen.y, seen.width - 1, seen.height - 1}));
    ASSERT_EQ(info.at("bbox_obj").size(), 4u);
    if (k == 2) {
      // What lies beyond the border counts.
      EXPECT_GT(all_px, 1.2 * cv::countNonZero(whole));
      EXPECT_LT(info["bbox_obj"][0], 0);
    } else {
      const cv::Rect box = cv::boundingRect(whole);
      EXPECT_EQ(all_px, cv::countNonZero(whole)) << k;
      EXPECT_EQ(info["bbox_obj"], json({box.x, box.y, box.width - 1, box.height - 1})) << k;
    }
  }
  EXPECT_LT(all["0"][1]["visib_fract"], 0.95);  // behind the box
}

TEST_F(BopFormat, TargetsNameWhatCanBeSeen) {
  const json targets = read_json(set() + "/test_targets_bop19.json");
  ASSERT_TRUE(targets.is_array());
  std::set<std::tuple<int, int, int>> seen;
  for (const json& target : targets) {
    seen.emplace(target.at("scene_id"), target.at("im_id"), target.at("obj_id"));
    EXPECT_EQ(target.at("inst_count"), target["obj_id"] == 2 ? 2 : 1);
  }
  EXPECT_EQ(seen.size(), targets.size());
  EXPECT_EQ(seen.size(), 2u * 2 * 3);  // scenes, images, kinds
}

TEST_F(BopFormat, ModelsForTheEvaluationToo) {
  for (const char* folder : {"models", "models_eval"}) {
    const json info = read_json(set() + "/" + folder + "/models_info.json");
    for (int id = 1; id <= 3; ++id) {
      const json& model = info.at(std::to_string(id));
      for (const char* key : {"diameter", "min_x", "min_y", "min_z", "size_x", "size_y", "size_z"}) {
        EXPECT_TRUE(model.at(key).is_number()) << key;
      }
      for (const json& symmetry : model.value("symmetries_discrete", json::array())) EXPECT_EQ(symmetry.size(), 16u);
      for (const json& symmetry : model.value("symmetries_continuous", json::array())) {
        EXPECT_EQ(symmetry.at("axis").size(), 3u);
        EXPECT_EQ(symmetry.at("offset").size(), 3u);
      }
    }
    EXPECT_NEAR(info["1"]["diameter"], std::sqrt(50 * 50 + 30 * 30 + 20 * 20), 1e-3);
    EXPECT_EQ(info["3"]["symmetries_continuous"][0]["axis"], json({0.0, 0.0, 1.0}));
  }
}

TEST_F(BopFormat, MeshesAreWhatTheToolkitsReaderKnows) {
  std::ifstream file(set() + "/models_eval/obj_000001.ply", std::ios::binary);
  std::stringstream bytes;
  bytes << file.rdbuf();
  const std::string ply = bytes.str();
  const auto end = ply.find("end_header\n");
  ASSERT_NE(end, std::string::npos);
  std::istringstream header(ply.substr(0, end));
  std::size_t points = 0, faces = 0, point_bytes = 0;
  bool vertices = false;
  std::set<std::string> names;
  for (std::string line; std::getline(header, line);) {
    std::istringstream words(line);
    std::string first, second, third;
    words >> first >> second >> third;
    if (first == "element") {
      vertices = second == "vertex";
      (vertices ? points : faces) = std::stoul(third);
    } else if (first == "property" && vertices) {
      // load_ply knows float, double, int and uchar by these names.
      EXPECT_TRUE(second == "float") << line;
      names.insert(third);
      point_bytes += 4;
    } else if (first == "property") {
      EXPECT_EQ(line, "property list uchar int vertex_indices");
    }
  }
  EXPECT_EQ(names, (std::set<std::string>{"x", "y", "z", "nx", "ny", "nz"}));
  ASSERT_EQ(ply.size(), end + 11 + points * point_bytes + faces * 13);
  const char* at = ply.data() + end + 11;
  for (std::size_t i = 0; i < points; ++i, at += point_bytes) {
    Eigen::Matrix<float, 6, 1> p;
    std::memcpy(p.data(), at, sizeof p);
    EXPECT_NEAR(p.tail<3>().norm(), 1, 1e-5);
    // At the corner of a box about the origin the normal points outwards along all three edges.
    EXPECT_GT(p.head<3>().cwiseProduct(p.tail<3>()).minCoeff(), 0);
  }
  for (std::size_t i = 0; i < faces; ++i, at += 13) {
    EXPECT_EQ(at[0], 3);  // triangles only
    std::array<std::int32_t, 3> corners{};
    std::memcpy(corners.data(), at + 1, sizeof corners);
    for (const std::int32_t corner : corners) EXPECT_LT(corner, static_cast<std::int32_t>(points));
  }
}

}  // namespace
}  // namespace binrig
