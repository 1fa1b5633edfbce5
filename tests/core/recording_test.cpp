#include <gtest/gtest.h>
#include <sys/resource.h>
#include <csignal>

#include <filesystem>
#include <fstream>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/error.h"
#include "core/recording_set.h"
#include "core/recording_writer.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

namespace fs = std::filesystem;
using test::full_frame;
using test::ScratchFolder;

CaptureInfo capture_info(int id = 1) {
  CaptureInfo capture;
  capture.split = "train";
  capture.id = id;
  capture.name = "plane_720";
  capture.target = TargetKind::plane;
  capture.power_on = true;
  return capture;
}

SetInfo set_info() {
  SetInfo info;
  info.sensor.name = "test sensor";
  info.sensor.baseline_mm = 100;
  info.sensor.projector_xyz_mm = Vector3(100, 1, 2);
  info.sensor.range_mm = {{700, 900}};
  info.sensor.frame_rate_hz = 3;
  info.pose_sigma_mm = 0.15;
  info.pose_sigma_rad = 0.0003;
  info.cam_K_sigma_px = {{0.5, 0.1, 0.2}};
  return info;
}

void write_set(const std::string& path, int frames) {
  RecordingWriter writer(path, set_info());
  writer.begin_capture(capture_info());
  for (int i = 0; i < frames; ++i) writer.write(full_frame(i));
  writer.finish_capture();
}

// The Error that `call` throws, as text; a failure if it throws none.
template <typename Call>
std::string thrown_by(Call call) {
  try {
    call();
  } catch (const Error& problem) {
    return problem.what();
  }
  ADD_FAILURE() << "no Error was thrown";
  return "";
}

void overwrite(const std::string& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

TEST(Recording, WhatIsWrittenComesBackEqual) {
  ScratchFolder folder;
  write_set(folder / "set", 3);
  const RecordingSet set = RecordingSet::open(folder / "set");
  ASSERT_EQ(set.captures().size(), 1u);
  EXPECT_EQ(set.captures()[0].frames, 3);
  EXPECT_EQ(set.captures()[0].name, "plane_720");
  EXPECT_EQ(set.captures()[0].target, TargetKind::plane);
  EXPECT_TRUE(set.captures()[0].power_on);
  EXPECT_EQ(set.info().sensor.projector_xyz_mm, Vector3(100, 1, 2));
  EXPECT_EQ(set.info().cam_K_sigma_px, set_info().cam_K_sigma_px);
  const CaptureReader capture = set.capture("train/1");
  ASSERT_EQ(capture.size(), 3);
  for (int i = 0; i < 3; ++i) {
    const Frame frame = capture.frame(i);
    frame.check("replayed");
    EXPECT_EQ(difference(frame, full_frame(i)), "") << "frame " << i;
  }
}

TEST(Recording, DifferenceSeesEveryField) {
  const Frame a = full_frame(0);
  const auto differs = [&](auto change) {
    Frame b = full_frame(0);
    change(b);
    return difference(a, b) != "";
  };
  EXPECT_EQ(difference(a, full_frame(0)), "");
  EXPECT_TRUE(differs([](Frame& f) { f.depth_mm.at<float>(1, 1) += 0.1f; }));
  EXPECT_TRUE(differs([](Frame& f) { f.ir.at<std::uint16_t>(1, 1) += 1; }));
  EXPECT_TRUE(differs([](Frame& f) { f.reason.at<std::uint8_t>(0, 0) = 12; }));
  EXPECT_TRUE(differs([](Frame& f) { f.rgb.at<cv::Vec3b>(0, 0)[1] ^= 1; }));
  EXPECT_TRUE(differs([](Frame& f) { f.ids.at<std::uint16_t>(0, 0) ^= 1; }));
  EXPECT_TRUE(differs([](Frame& f) { f.camera.fx += 1e-3; }));
  EXPECT_TRUE(differs([](Frame& f) { f.camera.distortion[2] += 1e-6; }));
  EXPECT_TRUE(differs([](Frame& f) { f.X_WC.reset(); }));
  EXPECT_TRUE(differs([](Frame& f) { f.objects->pop_back(); }));
  EXPECT_TRUE(differs([](Frame& f) { (*f.objects)[0].X_CO.translation().x() += 1e-3; }));
  EXPECT_TRUE(differs([](Frame& f) { f.time_s = 1e-3; }));
  EXPECT_TRUE(differs([](Frame& f) { f.host_time_s.reset(); }));
  EXPECT_TRUE(differs([](Frame& f) { f.sequence = 1; }));
  EXPECT_TRUE(differs([](Frame& f) { f.status = FrameStatus::incomplete; }));
}

TEST(Recording, SilenceOfTheDeviceIsKept) {
  ScratchFolder folder;
  {
    RecordingWriter writer(folder / "set", set_info());
    writer.begin_capture(capture_info());
    Frame silent;
    silent.camera = full_frame(0).camera;
    silent.status = FrameStatus::timeout;
    silent.depth_scale_mm = 0.1;
    writer.write(full_frame(0));
    writer.write(silent);
    writer.write(full_frame(2));
  }
  const CaptureReader capture = RecordingSet::open(folder / "set").capture("train/1");
  ASSERT_EQ(capture.size(), 3);
  EXPECT_EQ(capture.frame(1).status, FrameStatus::timeout);
  EXPECT_TRUE(capture.frame(1).depth_mm.empty());
  EXPECT_EQ(difference(capture.frame(2), full_frame(2)), "");
}

// What a killed process leaves: images and a journal whose last line is half written.
TEST(Recording, KilledRecordingStaysReadable) {
  ScratchFolder folder;
  const std::string set_path = folder / "set";
  auto* writer = new RecordingWriter(set_path, set_info());  // never finished, never destroyed: as if killed
  writer->begin_capture(capture_info());
  for (int i = 0; i < 3; ++i) writer->write(full_frame(i));
  std::ofstream(set_path + "/train/000001/journal.jsonl", std::ios::app) << "{\"id\": 3, \"camera\": {\"cam_";
  const CaptureReader capture = RecordingSet::open(set_path).capture("train/1");
  ASSERT_EQ(capture.size(), 3);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(difference(capture.frame(i), full_frame(i)), "");
  delete writer;  // tidies up: afterwards the capture is whole
}

TEST(Recording, CaptureIsAddedToAnExistingSetOfTheSameSensorOnly) {
  ScratchFolder folder;
  write_set(folder / "set", 1);
  {
    RecordingWriter writer(folder / "set", set_info());
    EXPECT_NE(thrown_by([&] { writer.begin_capture(capture_info()); }).find("already has"), std::string::npos);
    writer.begin_capture(capture_info(2));
    writer.write(full_frame(5));
    writer.finish_capture();
  }
  EXPECT_EQ(RecordingSet::open(folder / "set").captures().size(), 2u);
  SetInfo other = set_info();
  other.sensor.name = "another";
  EXPECT_NE(thrown_by([&] { RecordingWriter(folder / "set", other); }).find("another sensor"), std::string::npos);
}

TEST(Recording, SpeaksOfAMarkedTargetWhereEveryFrameMarksIt) {
  SetInfo info = set_info();
  info.region_masks = true;
  const Frame first = full_frame(0);
  const int rows = first.depth_mm.rows, cols = first.depth_mm.cols;
  info.valid_region = cv::Mat(rows, cols, CV_8U, cv::Scalar(255));
  info.valid_region.row(5).setTo(0);
  ScratchFolder folder;
  RecordingWriter writer(folder / "set", info);
  CaptureInfo plane = capture_info(1), scene = capture_info(2);
  scene.target = TargetKind::scene;
  for (const CaptureInfo& capture : {plane, scene}) {
    writer.begin_capture(capture);
    for (int i = 0; i < 2; ++i) {
      Frame frame = full_frame(i);
      frame.objects.reset();
      frame.ids = cv::Mat::zeros(rows, cols, CV_16U);
      frame.ids.colRange(i == 0 ? 0 : 6, cols).setTo(1);  // the second frame marks less
      writer.write(frame);
    }
    writer.finish_capture();
  }
  const RecordingSet set = RecordingSet::open(folder / "set");
  const cv::Mat marked = set.region(plane), all = set.region(scene);
  for (int v = 0; v < rows; ++v)
    for (int u = 0; u < cols; ++u) {
      EXPECT_EQ(all.at<std::uint8_t>(v, u) != 0, v != 5);
      EXPECT_EQ(marked.at<std::uint8_t>(v, u) != 0, v != 5 && u >= 8) << v << " " << u;  // 2 px inside the rim
    }
}

TEST(RecordingBadInput, OneBrokenFileIsOneErrorAndTheOtherFramesStayUsable) {
  ScratchFolder folder;
  write_set(folder / "set", 4);
  const std::string capture_folder = folder / "set/train/000001";
  fs::resize_file(capture_folder + "/depth/000000.png", fs::file_size(capture_folder + "/depth/000000.png") / 2);
  cv::imwrite(capture_folder + "/depth/000001.png", cv::Mat(16, 24, CV_8U, cv::Scalar(7)));
  fs::remove(capture_folder + "/depth/000002.png");
  const CaptureReader capture = RecordingSet::open(folder / "set").capture("train/1");
  ASSERT_EQ(capture.size(), 4);
  const std::string truncated = thrown_by([&] { capture.frame(0); });
  EXPECT_NE(truncated.find("000000.png"), std::string::npos);
  EXPECT_NE(truncated.find("truncated"), std::string::npos);
  const std::string eight_bit = thrown_by([&] { capture.frame(1); });
  EXPECT_NE(eight_bit.find("000001.png"), std::string::npos);
  EXPECT_NE(eight_bit.find("16 bits"), std::string::npos);
  EXPECT_NE(thrown_by([&] { capture.frame(2); }).find("000002.png"), std::string::npos);
  EXPECT_EQ(difference(capture.frame(3), full_frame(3)), "");
}

TEST(RecordingBadInput, WrongImageSizeNamesBoth) {
  ScratchFolder folder;
  write_set(folder / "set", 1);
  cv::imwrite(folder / "set/train/000001/depth/000000.png", cv::Mat(8, 8, CV_16U, cv::Scalar(7)));
  const std::string text = thrown_by([&] { RecordingSet::open(folder / "set").capture("train/1").frame(0); });
  EXPECT_NE(text.find("8 x 8"), std::string::npos);
  EXPECT_NE(text.find("24 x 16"), std::string::npos);
}

TEST(RecordingBadInput, CameraWithoutKOrWithBadScaleNamesFileAndFrame) {
  ScratchFolder folder;
  write_set(folder / "set", 3);
  fs::remove(folder / "set/camera.json");
  overwrite(folder / "set/train/000001/scene_camera.json",
            R"({"0": {"depth_scale": 0.1}, "1": {"cam_K": [50,0,12,0,50,8,0,0,1], "depth_scale": 0},
                "2": {"cam_K": [50,0,12,0,50,8,0,0,1], "depth_scale": -0.1}})");
  const CaptureReader capture = RecordingSet::open(folder / "set").capture("train/1");
  const std::string no_k = thrown_by([&] { capture.frame(0); });
  EXPECT_NE(no_k.find("scene_camera.json, frame 0"), std::string::npos) << no_k;
  EXPECT_NE(no_k.find("cam_K"), std::string::npos);
  for (int i : {1, 2}) {
    const std::string scale = thrown_by([&] { capture.frame(i); });
    EXPECT_NE(scale.find("depth_scale"), std::string::npos);
    EXPECT_NE(scale.find("frame " + std::to_string(i)), std::string::npos);
  }
}

TEST(RecordingBadInput, NotANumberAndNotJson) {
  ScratchFolder folder;
  write_set(folder / "set", 1);
  overwrite(folder / "set/train/000001/scene_camera.json", R"({"0": {"cam_K": [null,0,12,0,50,8,0,0,1]}})");
  EXPECT_NE(thrown_by([&] { RecordingSet::open(folder / "set").capture("train/1").frame(0); }).find("cam_K"),
            std::string::npos);
  overwrite(folder / "set/train/000001/scene_camera.json", "{\"0\": {");
  EXPECT_NE(thrown_by([&] { RecordingSet::open(folder / "set").capture("train/1"); }).find("not JSON"),
            std::string::npos);
  overwrite(folder / "set/recording.json", "nothing");
  EXPECT_NE(thrown_by([&] { RecordingSet::open(folder / "set"); }).find("recording.json"), std::string::npos);
}

TEST(RecordingBadInput, FramesWithNanAreRefused) {
  ScratchFolder folder;
  RecordingWriter writer(folder / "set", set_info());
  writer.begin_capture(capture_info());
  Frame frame = full_frame(0);
  frame.depth_mm.at<float>(3, 4) = std::nanf("");
  const std::string text = thrown_by([&] { writer.write(frame); });
  EXPECT_NE(text.find("(4, 3)"), std::string::npos) << text;
  EXPECT_FALSE(fs::exists(folder / "set/train/000001/depth/000000.png"));
}

TEST(RecordingBadInput, WhatIsNoSet) {
  ScratchFolder folder;
  EXPECT_NE(thrown_by([&] { RecordingSet::open(folder / "nothing"); }).find("not a directory"), std::string::npos);
  EXPECT_NE(thrown_by([&] { RecordingSet::open(folder.path()); }).find("no recording set"), std::string::npos);
  write_set(folder / "set", 1);
  fs::remove_all(folder / "set/train");
  EXPECT_NE(thrown_by([&] { RecordingSet::open(folder / "set"); }).find("train/000001"), std::string::npos);
}

// A file-size limit stands in for a full disk: write(2) fails in the same way, with another errno.
TEST(RecordingBadInput, FullDiskLeavesNothingHalfWritten) {
  ScratchFolder folder;
  RecordingWriter writer(folder / "set", set_info());
  writer.begin_capture(capture_info());
  writer.write(full_frame(0));
  rlimit before;
  getrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, SIG_IGN);
  rlimit tight = before;
  tight.rlim_cur = 400;  // smaller than any image of the frame
  setrlimit(RLIMIT_FSIZE, &tight);
  const std::string text = thrown_by([&] { writer.write(full_frame(1)); });
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_NE(text.find("cannot write"), std::string::npos);
  for (const auto& file : fs::recursive_directory_iterator(folder / "set")) {
    EXPECT_EQ(file.path().string().find("/000001.png"), std::string::npos) << file.path();
    EXPECT_NE(file.path().extension(), ".part") << file.path();
  }
  writer.write(full_frame(2));  // space again: recording goes on
  writer.finish_capture();
  const CaptureReader capture = RecordingSet::open(folder / "set").capture("train/1");
  ASSERT_EQ(capture.size(), 2);
  EXPECT_EQ(difference(capture.frame(0), full_frame(0)), "");
  EXPECT_EQ(difference(capture.frame(1), full_frame(2)), "");
}

TEST(RecordingShared, EverySharedSetOpensAndEveryFrameReads) {
  const std::string root = test::shared_recording("real");
  if (root.empty()) GTEST_SKIP() << "the shared recordings are not on this machine";
  int frames = 0;
  for (const auto& entry : fs::recursive_directory_iterator(root)) {
    if (entry.path().filename() != "recording.json") continue;
    const RecordingSet set = RecordingSet::open(entry.path().parent_path());
    for (const CaptureInfo& info : set.captures()) {
      const CaptureReader capture = set.capture(info.key());
      EXPECT_EQ(capture.size(), info.frames) << set.info().path << " " << info.key();
      for (int i = 0; i < capture.size(); ++i) {
        ASSERT_NO_THROW(capture.frame(i).check(info.key())) << set.info().path << " " << info.key();
        ++frames;
      }
    }
  }
  EXPECT_GT(frames, 90);
}

}  // namespace
}  // namespace binrig
