#include <fstream>

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "app/forward.h"
#include "calib/box_fit.h"
#include "calib/projector_fit.h"
#include "sim/effect.h"
#include "sim/renderer.h"
#include "tests/support/program.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

// A box of known size on a known plane, rendered; what is seen of it (top and two sides) must give its footprint,
// height and place back. One pixel is 1.3 mm there, so 3 mm bounds what the loss of the outermost 1 % and the pixels
// allow.
TEST(BoxFit, FindsSizeAndPlaceOfARenderedBox) {
  RenderScene scene;
  const Camera camera = camera_from_field_of_view(640, 480, 0.9);
  Pose X_CP = Pose::Identity();  // the table: seen 40 degrees from above
  X_CP.rotate(Eigen::AngleAxisd(M_PI - 0.7, Vector3::UnitX()));
  X_CP.translation() = Vector3(0, 40, 900);
  const Vector3 size(120, 70, 90);
  Pose X_PO = Pose::Identity();
  X_PO.rotate(Eigen::AngleAxisd(0.5, Vector3::UnitZ()));
  X_PO.translation() = Vector3(10, -20, 45);
  SceneObject box;
  box.mesh = box_mesh(size, Surface{});
  box.X_CO = X_CP * X_PO;
  SceneObject table;
  table.mesh = rectangle_mesh(1500, 1500, Surface{});
  table.X_CO = X_CP;
  scene.objects = {table, box};
  RenderRequest request;
  request.camera = camera;
  request.wanted = Channel::depth | Channel::instance;
  const auto channels = make_renderer("embree")->render(scene, request);
  const PixelRays rays(camera);
  const PlaneFit plane = fit_plane(channels->depth_mm, rays, channels->instance == 1);
  const BoxFit fit = fit_box(channels->depth_mm, rays, channels->instance == 2, plane);
  std::vector<double> sides{fit.size_mm.x(), fit.size_mm.y()};
  std::sort(sides.begin(), sides.end());
  EXPECT_NEAR(sides[0], 70, 3);
  EXPECT_NEAR(sides[1], 120, 3);
  EXPECT_NEAR(fit.size_mm.z(), 90, 1.5);
  EXPECT_LT(distance_between_mm(fit.X_CO, box.X_CO), 3);
  EXPECT_LT(fit.rms_mm, 1.5);
}

TEST(BoxFit, TooFewPointsAreAnError) {
  const Camera camera = camera_from_field_of_view(40, 30, 0.9);
  cv::Mat depth(30, 40, CV_32F, cv::Scalar(800)), mask = cv::Mat::zeros(30, 40, CV_8U);
  const PixelRays rays(camera);
  const PlaneFit plane = fit_plane(depth, rays, cv::Mat(30, 40, CV_8U, cv::Scalar(255)));
  mask(cv::Rect(0, 0, 5, 5)) = 255;
  EXPECT_THROW(fit_box(depth, rays, mask, plane), Error);
}

// The bench recordings say where their projector stands, (100, 0, 0) mm; its shadows alone must say the same. One pixel
// of shadow edge at the step's height of 60 mm in 800 is 0.7 mm / (60 / 740) = 9 mm of baseline; there are about 100
// rows.
TEST(ProjectorFit, ShadowsOfTheBenchRecordingGiveTheProjectorsPlace) {
  const std::string path = test::shared_recording("bench/kit-a");
  if (path.empty()) GTEST_SKIP() << "the shared recordings are not on this machine";
  ForwardOptions options;
  const Forward forward = open_forward_model(path, options);
  const SensorModel model = parse_sensor_model("name: fit\nprojector: fit\n", "fit", effect_catalogue());
  const ProjectorFit fit = fit_projector(*forward.model, RecordingSet::open(path), model);
  std::printf("%s; sigma %.1f %.1f %.1f mm\n", fit.message.c_str(), fit.sigma_mm[0], fit.sigma_mm[1], fit.sigma_mm[2]);
  ASSERT_TRUE(fit.found) << fit.message;
  EXPECT_NEAR(fit.xyz_mm.x(), 100, 9);
  EXPECT_NEAR(fit.xyz_mm.y(), 0, 20);
  // No second camera here: none is found where one is looked for.
  const ProjectorFit second = fit_projector(*forward.model, RecordingSet::open(path), model, true);
  EXPECT_FALSE(second.second_x_mm) << second.message;
  EXPECT_NEAR(second.xyz_mm.x(), fit.xyz_mm.x(), 1e-9);
}

// Depth in the view of a colour camera: the projector 60 mm to the right, the sensor's own camera 40 mm to the left, a
// box 50 mm high at 400. One pixel of shadow edge is 1 / (772 (1/350 - 1/400)) = 3.6 mm of baseline.
TEST(ProjectorFit, TwoShadowsGiveTwoPlaces) {
  const test::ScratchFolder folder;
  std::ofstream(folder / "world.yaml") << R"(
parts: [{part: box, poses: [{translation: [0, 0, 25], rotation_vector_deg: [0, 90, 0]}]}]
table: {height: 0}
sensors:
  - {name: above, pose: {from: [0, 0, 400], at: [0, 0, 0]}, camera: {width: 640, height: 480, horizontal_fov_deg: 45},
     range: [300, 500], projector: [60, 0, 0]}
)";
  std::ofstream(folder / "two.yaml") << "name: two\ndepth_scale: 0.02\neffects:\n"
                                        "  - projector_shadow: {bias: 1}\n  - second_shadow: {baseline: -40}\n";
  const test::Run run = test::run_binrig("simulate --quiet --no-rgb --split train --world " + (folder / "world.yaml") +
                                         " --model " + (folder / "two.yaml") + " --out " + (folder / "set"));
  ASSERT_EQ(run.status, 0) << run.output;
  const Forward forward = open_forward_model(folder / "set");
  SensorModel model = parse_sensor_model("name: fit\nprojector: fit\neffects: [second_shadow: {baseline: 5}]\n", "fit",
                                         effect_catalogue());
  const std::string message = settle_projector(model, *forward.model);
  ASSERT_TRUE(model.projector_known) << message;
  EXPECT_NEAR(model.projector_xyz_mm.x(), 60, 6) << message;
  EXPECT_NEAR(model.effects[0].value("baseline"), -40, 6) << message;
  // One place alone leaves the other shadow unexplained.
  const ProjectorFit alone = fit_projector(*forward.model, RecordingSet::open(folder / "set"), model);
  const ProjectorFit both = fit_projector(*forward.model, RecordingSet::open(folder / "set"), model, true);
  EXPECT_GT(both.iou, 0.9);
  EXPECT_LT(alone.iou, 0.75);
}

TEST(ProjectorFit, WithoutShadowsThePlaceStaysUnknown) {
  const std::string path = test::shared_recording("real/d415-table");
  if (path.empty()) GTEST_SKIP() << "the shared recordings are not on this machine";
  const Forward forward = open_forward_model(path);
  const SensorModel model = parse_sensor_model("name: fit\nprojector: fit\n", "fit", effect_catalogue());
  const ProjectorFit fit = fit_projector(*forward.model, RecordingSet::open(path), model);
  EXPECT_FALSE(fit.found);
  EXPECT_NE(fit.message.find("stays unknown"), std::string::npos);
}

}  // namespace
}  // namespace binrig
