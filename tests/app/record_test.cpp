// binrig record, as a user runs it.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "core/recording_set.h"
#include "tests/support/program.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

using test::run_binrig;

TEST(RecordVerb, WhatIsRerecordedIsEqualFrameByFrame) {
  int compared = 0;
  for (const char* name : {"real/d415-table", "real/kinect1-boxes", "real/xtion-ycb", "real/sr300-totes",
                           "real/truedepth-planes/truedepth-iphone11pro"}) {
    const std::string from = test::shared_recording(name);
    if (from.empty()) GTEST_SKIP() << "the shared recordings are not on this machine";
    test::ScratchFolder folder;
    const test::Run run = run_binrig("record --quiet --from replay:" + from + " --out " + (folder / "copy"));
    ASSERT_EQ(run.status, 0) << run.output;
    const RecordingSet a = RecordingSet::open(from), b = RecordingSet::open(folder / "copy");
    ASSERT_EQ(a.captures().size(), b.captures().size());
    for (const CaptureInfo& info : a.captures()) {
      const CaptureReader x = a.capture(info.key()), y = b.capture(info.key());
      ASSERT_EQ(x.size(), y.size());
      for (int i = 0; i < x.size(); ++i, ++compared) EXPECT_EQ(difference(x.frame(i), y.frame(i)), "") << name << " " << info.key();
    }
    EXPECT_EQ(a.models().size(), b.models().size());
    EXPECT_EQ(a.info().pose_sigma_mm, b.info().pose_sigma_mm);
  }
  EXPECT_GT(compared, 40);
}

TEST(RecordVerb, BadUsageIsStatusTwoAndOneClearError) {
  test::ScratchFolder folder;
  const auto fails = [&](const std::string& arguments, const std::string& words) {
    const test::Run run = run_binrig(arguments);
    EXPECT_EQ(run.status, 2) << arguments << "\n" << run.output;
    EXPECT_NE(run.output.find(words), std::string::npos) << run.output;
  };
  fails("record --from replay:" + folder.path() + " --out " + (folder / "x"), "no recording set");
  fails("record --from nothing:here --out " + (folder / "x"), "replay:SET");
  fails("record --out " + (folder / "x"), "--from");
  fails("recrod", "did you mean record?");
  fails("effects spectral_nose", "did you mean spectral_noise?");
  EXPECT_FALSE(std::filesystem::exists(folder / "x"));
}

TEST(DevicesVerb, ADeviceThatCannotBeOpenedSaysWhy) {
  test::ScratchFolder folder;
  const std::string device = folder / "1-1";
  std::filesystem::create_directories(device);
  for (const auto& [file, text] : {std::pair{"idVendor", "1d27"}, {"idProduct", "0600"}, {"busnum", "99"}, {"devnum", "7"},
                                   {"product", "PrimeSense Device"}}) {
    std::ofstream(device + "/" + file) << text << "\n";
  }
  const test::Run run = run_binrig("devices --sysfs " + folder.path());
  EXPECT_EQ(run.status, 0);
  EXPECT_NE(run.output.find("1d27:0600"), std::string::npos) << run.output;
  EXPECT_NE(run.output.find("/dev/bus/usb/099/007 does not exist"), std::string::npos) << run.output;
}

}  // namespace
}  // namespace binrig
