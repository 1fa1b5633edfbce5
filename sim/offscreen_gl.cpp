#include "sim/offscreen_gl.h"

#define GL_GLEXT_PROTOTYPES
#include <GL/osmesa.h>
// After osmesa.h, which brings gl.h.
#include <GL/glext.h>

#include "core/error.h"

namespace binrig {

namespace {
constexpr int window_size = 16;

std::string log_of(unsigned object, bool is_program) {
  int length = 0;
  is_program ? glGetProgramiv(object, GL_INFO_LOG_LENGTH, &length) : glGetShaderiv(object, GL_INFO_LOG_LENGTH, &length);
  std::string log(static_cast<std::size_t>(std::max(length, 1)), '\0');
  is_program ? glGetProgramInfoLog(object, length, nullptr, log.data())
             : glGetShaderInfoLog(object, length, nullptr, log.data());
  while (!log.empty() && (log.back() == '\0' || log.back() == '\n')) log.pop_back();
  return log;
}

std::string driver_name() {
  const auto* name = reinterpret_cast<const char*>(glGetString(GL_RENDERER));
  const auto* version = reinterpret_cast<const char*>(glGetString(GL_VERSION));
  return std::string(name ? name : "an unknown driver") + ", OpenGL " + (version ? version : "?");
}

unsigned compiled(unsigned kind, const std::string& source) {
  const unsigned shader = glCreateShader(kind);
  const char* text = source.c_str();
  glShaderSource(shader, 1, &text, nullptr);
  glCompileShader(shader);
  int done = 0;
  glGetShaderiv(shader, GL_COMPILE_STATUS, &done);
  if (!done) {
    const std::string log = log_of(shader, false);
    glDeleteShader(shader);
    throw Error("A " + std::string(kind == GL_VERTEX_SHADER ? "vertex" : "fragment") + " shader does not compile on " +
                driver_name() + ":\n" + log);
  }
  return shader;
}
}  // namespace

OffscreenGl::OffscreenGl() : window_(4 * window_size * window_size) {
  const int attributes[] = {OSMESA_FORMAT,
                            OSMESA_RGBA,
                            OSMESA_PROFILE,
                            OSMESA_CORE_PROFILE,
                            OSMESA_CONTEXT_MAJOR_VERSION,
                            4,
                            OSMESA_CONTEXT_MINOR_VERSION,
                            5,
                            0};
  context_ = OSMesaCreateContextAttribs(attributes, nullptr);
  if (!context_) throw Error("OSMesa gives no OpenGL 4.5 core profile: update Mesa, or use the renderer embree.");
  const Current current(*this);
  driver_ = driver_name();
}

OffscreenGl::~OffscreenGl() { OSMesaDestroyContext(static_cast<OSMesaContext>(context_)); }

OffscreenGl::Current::Current(OffscreenGl& gl) : lock_(gl.mutex_) {
  if (!OSMesaMakeCurrent(static_cast<OSMesaContext>(gl.context_), gl.window_.data(), GL_UNSIGNED_BYTE, window_size,
                         window_size)) {
    throw Error("OSMesa does not make its context current.");
  }
}

OffscreenGl::Current::~Current() { OSMesaMakeCurrent(nullptr, nullptr, 0, 0, 0); }

unsigned OffscreenGl::program(const std::string& vertex_source, const std::string& fragment_source) {
  const unsigned vertex = compiled(GL_VERTEX_SHADER, vertex_source);
  unsigned fragment = 0;
  try {
    fragment = compiled(GL_FRAGMENT_SHADER, fragment_source);
  } catch (...) {
    glDeleteShader(vertex);
    throw;
  }
  const unsigned program = glCreateProgram();
  glAttachShader(program, vertex);
  glAttachShader(program, fragment);
  glLinkProgram(program);
  glDeleteShader(vertex);
  glDeleteShader(fragment);
  int done = 0;
  glGetProgramiv(program, GL_LINK_STATUS, &done);
  if (!done) {
    const std::string log = log_of(program, true);
    glDeleteProgram(program);
    throw Error("The shaders do not link on " + driver_name() + ":\n" + log);
  }
  return program;
}

void check_gl(const std::string& what) {
  const unsigned error = glGetError();
  if (error == GL_NO_ERROR) return;
  while (glGetError() != GL_NO_ERROR) {
  }
  throw Error("OpenGL: " + what + " failed (" + (error == GL_OUT_OF_MEMORY ? "out of memory" : std::to_string(error)) +
              ").");
}

}  // namespace binrig
