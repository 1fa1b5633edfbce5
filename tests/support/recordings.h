// Recordings and scratch folders for tests.
#pragma once

#include <filesystem>
#include <string>

#include "core/frame.h"

namespace binrig::test {

/// Path of a shared recording ("bench/kit-a"), or "" where the shared recordings are absent: the test then skips and
/// says so.
std::string shared_recording(const std::string& name);

/// A fresh folder, removed with everything in it at the end.
class ScratchFolder {
 public:
  ScratchFolder();
  ~ScratchFolder();
  std::string path() const { return path_.string(); }
  std::string operator/(const std::string& name) const { return (path_ / name).string(); }

 private:
  std::filesystem::path path_;
};

/// A small frame in which everything is present: depth on the steps of 0.1 mm with holes of several reasons, IR, RGB,
/// two instances with poses, camera pose, times.
Frame full_frame(int number);

}  // namespace binrig::test
