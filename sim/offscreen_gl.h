// OpenGL without a window, on the CPU (OSMesa). The only place, with osmesa_renderer.cpp, that knows GL.
#pragma once

#include <mutex>
#include <string>
#include <vector>

namespace binrig {

/// One core-profile context. A GL context belongs to one thread at a time: hold a Current while calling GL.
class OffscreenGl {
 public:
  /// Throws Error if the driver gives no core profile of version 4.5 or later.
  OffscreenGl();
  ~OffscreenGl();
  OffscreenGl(const OffscreenGl&) = delete;
  OffscreenGl& operator=(const OffscreenGl&) = delete;

  class Current {
   public:
    explicit Current(OffscreenGl& gl);
    ~Current();
    Current(const Current&) = delete;
    Current& operator=(const Current&) = delete;

   private:
    std::lock_guard<std::mutex> lock_;
  };

  /// A linked program (its GL name). Throws Error with the driver's log if a shader does not compile or link.
  static unsigned program(const std::string& vertex_source, const std::string& fragment_source);
  /// "llvmpipe (LLVM 15.0.6, 256 bits)"
  const std::string& driver() const { return driver_; }

 private:
  void* context_;
  std::vector<unsigned char> window_;  // what the context draws to by default; nobody looks at it
  std::mutex mutex_;
  std::string driver_;
};

/// Throws Error naming `what` if GL has recorded an error.
void check_gl(const std::string& what);

}  // namespace binrig
