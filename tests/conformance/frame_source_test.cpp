// What every FrameSource must do, whatever it is made of (core/frame_source.h). A new kind adds one line to kinds().
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <ostream>

#include "app/open.h"
#include "core/error.h"
#include "core/recording_writer.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

using namespace std::chrono_literals;

struct Kind {
  std::string name;
  std::function<std::string(const test::ScratchFolder&)> uri;  ///< makes what the source needs; a finite source

  friend void PrintTo(const Kind& kind, std::ostream* os) { *os << kind.name; }
};

std::string recorded(const test::ScratchFolder& folder) {
  SetInfo info;
  info.sensor.name = "test sensor";
  info.sensor.frame_rate_hz = 100;
  RecordingWriter writer(folder / "set", info);
  for (int id : {1, 2}) {
    CaptureInfo capture;
    capture.split = "train";
    capture.id = id;
    writer.begin_capture(capture);
    for (int i = 0; i < 3; ++i) writer.write(test::full_frame(10 * id + i));
  }
  writer.finish_capture();
  return folder / "set";
}

std::vector<Kind> kinds() {
  const std::string root = BINRIG_SOURCE_DIR;
  return {
      {"replay", [](const auto& folder) { return "replay:" + recorded(folder) + "?rate=max"; }},
      {"replay_capture", [](const auto& folder) { return "replay:" + recorded(folder) + "#train/2"; }},
      {"simulated_set",
       [=](const auto&) { return "sim:" + root + "/fixtures/recorded/campaign-clean#train/6?model=" + root + "/models/thesis-five.yaml"; }},
      {"simulated_world",
       [=](const auto&) {
         return "sim:" + root + "/worlds/parts-on-a-table.yaml?frames=2&scenes=2&model=" + root + "/models/itri-2014.yaml";
       }},
      {"replay_real_time", [](const auto& folder) { return "replay:" + recorded(folder) + "#train/1?rate=real"; }},
  };
}

class Conformance : public testing::TestWithParam<Kind> {
 protected:
  void SetUp() override { source = open_source(GetParam().uri(folder)); }
  test::ScratchFolder folder;
  std::unique_ptr<FrameSource> source;
};

TEST_P(Conformance, NextBeforeStartAndStartTwiceAreErrors) {
  EXPECT_THROW(source->next(1s), Error);
  source->start();
  EXPECT_THROW(source->start(), Error);
  source->stop();
  source->stop();  // idempotent
  EXPECT_THROW(source->next(1s), Error);
}

TEST_P(Conformance, InfoIsTrueOfTheFramesAndEveryFrameIsWellFormed) {
  const SourceInfo info = source->info();
  EXPECT_FALSE(info.uri.empty());
  source->start();
  std::int64_t count = 0;
  double last_time_s = -1e300;
  std::int64_t last_sequence = std::numeric_limits<std::int64_t>::min();
  while (const std::optional<Frame> frame = source->next(5s)) {
    ASSERT_NO_THROW(frame->check("frame"));
    if (count == 0) {
      EXPECT_EQ(frame->camera, info.camera);
      EXPECT_EQ(frame->depth_scale_mm, info.depth_scale_mm);
    }
    if (frame->time_s && count % 3 != 0) {
      EXPECT_GE(*frame->time_s, last_time_s);
      EXPECT_GT(frame->sequence, last_sequence);
    }
    last_time_s = frame->time_s.value_or(last_time_s);
    last_sequence = frame->sequence;
    ++count;
    ASSERT_LT(count, 1000);
  }
  ASSERT_TRUE(info.frames.has_value());
  EXPECT_EQ(count, *info.frames);
  EXPECT_FALSE(source->next(10ms).has_value());  // the end stays the end
  EXPECT_EQ(source->info().frames, info.frames);
}

TEST_P(Conformance, StartAfterStopBeginsAnew) {
  source->start();
  const std::optional<Frame> first = source->next(5s);
  source->next(5s);
  source->stop();
  source->start();
  const std::optional<Frame> again = source->next(5s);
  ASSERT_TRUE(first && again);
  EXPECT_EQ(difference(*first, *again), "");
}

// record -> replay gives equal frames, for whatever a source delivers.
TEST_P(Conformance, RecordedAndReplayedItIsEqual) {
  {
    SetInfo set;
    set.sensor = source->info().sensor;
    RecordingWriter writer(folder / "again", set);
    CaptureInfo capture;
    capture.split = "test";
    capture.id = 7;
    writer.begin_capture(capture);
    source->start();
    while (const std::optional<Frame> frame = source->next(5s)) writer.write(*frame);
    source->stop();
  }
  const auto replay = open_source("replay:" + (folder / "again") + "#test/7");
  source->start();
  replay->start();
  while (const std::optional<Frame> frame = source->next(5s)) {
    const std::optional<Frame> copy = replay->next(5s);
    ASSERT_TRUE(copy.has_value());
    EXPECT_EQ(difference(*frame, *copy), "");
  }
  EXPECT_FALSE(replay->next(1s).has_value());
}

INSTANTIATE_TEST_SUITE_P(Sources, Conformance, testing::ValuesIn(kinds()), [](const auto& info) { return info.param.name; });

TEST(Replay, ABrokenFrameIsNamedAndTheNextOneFollows) {
  test::ScratchFolder folder;
  const std::string set = recorded(folder);
  std::filesystem::resize_file(set + "/train/000001/depth/000001.png", 100);
  const auto source = open_source("replay:" + set + "#train/1");
  source->start();
  EXPECT_EQ(difference(*source->next(1s), test::full_frame(10)), "");
  EXPECT_THROW(source->next(1s), Error);
  EXPECT_EQ(difference(*source->next(1s), test::full_frame(12)), "");
}

TEST(Replay, LoopsWithoutEndWhenAsked) {
  test::ScratchFolder folder;
  const auto source = open_source("replay:" + recorded(folder) + "#train/1?loop=1");
  EXPECT_FALSE(source->info().frames.has_value());
  source->start();
  for (int i = 0; i < 10; ++i) EXPECT_EQ(difference(*source->next(1s), test::full_frame(10 + i % 3)), "");
}

// Frames 1/3 s apart: with a timeout of 1 ms the second one is late, which is a status and no error.
TEST(Replay, ALateFrameIsATimeoutNotAnError) {
  test::ScratchFolder folder;
  const auto source = open_source("replay:" + recorded(folder) + "#train/1?rate=real");
  source->start();
  EXPECT_EQ(source->next(1s)->status, FrameStatus::complete);
  EXPECT_EQ(source->next(1ms)->status, FrameStatus::timeout);
  const std::optional<Frame> patient = source->next(5s);
  EXPECT_EQ(difference(*patient, test::full_frame(11)), "");
}

// Sources and bin of a cell share one world: the light that the bin switches off darkens the camera's next picture.
TEST(Cell, WhatTheBinDoesTheCameraSeesNext) {
  const std::string root = BINRIG_SOURCE_DIR;
  Cell cell = open_cell("sim:" + root + "/worlds/cylinder-9.yaml?model=" + root + "/models/itri-2014.yaml");
  ASSERT_EQ(cell.bins.size(), 1u);
  ASSERT_GE(cell.sources.size(), 1u);
  FrameSource& camera = *cell.sources[0];
  camera.start();
  const Frame before = *camera.next(5s), still = *camera.next(5s);
  ASSERT_EQ(before.objects->size(), 9u);
  for (std::size_t i = 0; i < 9; ++i) EXPECT_EQ((*before.objects)[i].X_CO.matrix(), (*still.objects)[i].X_CO.matrix());
  cell.bins[0]->command({BinCommand::Kind::shake, 1});
  const Frame after = *camera.next(5s);
  double moved_mm = 0;
  for (std::size_t i = 0; i < std::min(before.objects->size(), after.objects->size()); ++i) {
    moved_mm = std::max(moved_mm, distance_between_mm((*before.objects)[i].X_CO, (*after.objects)[i].X_CO));
  }
  EXPECT_GT(moved_mm, 1);
}

TEST(Open, WhatIsWrongIsSaid) {
  const auto text_of = [](const std::string& uri) -> std::string {
    try {
      open_source(uri);
    } catch (const Error& problem) {
      return problem.what();
    }
    return "";
  };
  test::ScratchFolder folder;
  const std::string set = recorded(folder);
  EXPECT_NE(text_of("nonsense").find("no scheme"), std::string::npos);
  EXPECT_NE(text_of("replya:x").find("replay:SET"), std::string::npos);
  EXPECT_NE(text_of("replay:" + set + "?raet=max").find("did you mean rate"), std::string::npos);
  EXPECT_NE(text_of("replay:" + set + "?rate=fast").find("real, max"), std::string::npos);
  EXPECT_NE(text_of("replay:" + set + "#train/9").find("train/1, train/2"), std::string::npos);
  EXPECT_NE(text_of("replay:" + set + "#nine").find("SPLIT/ID"), std::string::npos);
  EXPECT_NE(text_of("sim:" + set).find("model"), std::string::npos);
  EXPECT_NE(text_of("sim:nowhere.yaml").find("nowhere.yaml"), std::string::npos);
  const std::string world = std::string(BINRIG_SOURCE_DIR) + "/worlds/parts-on-a-table.yaml";
  EXPECT_NE(text_of("sim:" + world + "?seed=seven").find("whole number"), std::string::npos);
  EXPECT_NE(text_of("sim:" + world + "?sensor=9").find("0 .. "), std::string::npos);
  EXPECT_NE(text_of("sim:" + world + "?seeed=7").find("did you mean seed"), std::string::npos);
}

}  // namespace
}  // namespace binrig
