// One frame (depth and infra-red, 1280 x 960) of an 18-part bin through the thesis's five effects: every stage's CPU
// and wall time, beside the bare library calls measured in the same run, and how the time scales.
//
//   render_bench [--repeats 7] [--renderer embree,osmesa] [--scaling]
//
// CPU time is the steadier figure on a shared machine; "2 cores" is what two quiet cores would need if the work splits
// evenly. Figures are medians of the repeats after a warm-up frame.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#define GL_GLEXT_PROTOTYPES
#include <GL/osmesa.h>
#include <CLI/CLI.hpp>
// After osmesa.h, which brings gl.h.
#include <GL/glext.h>
#include <embree3/rtcore.h>
#include <opencv2/core.hpp>

#include "core/parallel.h"
#include "core/random.h"
#include "core/ray_table.h"
#include "core/spectrum.h"
#include "sim/effect.h"
#include "sim/offscreen_gl.h"
#include "sim/part_models.h"
#include "sim/sensor.h"
#include "sim/world.h"

namespace {
using namespace binrig;

struct Cost {
  double cpu_ms = 0, wall_ms = 0;
};

double median(std::vector<double> v) {
  std::sort(v.begin(), v.end());
  return v[v.size() / 2];
}

Cost measured(int repeats, const std::function<void()>& body) {
  body();
  std::vector<double> cpu, wall;
  for (int i = 0; i < repeats; ++i) {
    const auto t = std::chrono::steady_clock::now();
    const std::clock_t c = std::clock();
    body();
    cpu.push_back(1e3 * static_cast<double>(std::clock() - c) / CLOCKS_PER_SEC);
    wall.push_back(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - t).count());
  }
  return {median(cpu), median(wall)};
}

void row(const std::string& what, const Cost& cost, double share_of_ms = 0) {
  std::printf("  %-44s %8.1f %8.1f %9.1f", what.c_str(), cost.cpu_ms, cost.cpu_ms / 2, cost.wall_ms);
  if (share_of_ms > 0) std::printf("  %5.1f %%", 100 * cost.cpu_ms / share_of_ms);
  std::printf("\n");
}

// Parts at random in the bin; no physics, so that every part count and shape is the same kind of scene.
RenderScene bin_of(int parts, std::size_t triangles) {
  const RandomStream draws(7);
  RenderScene scene;
  const Surface steel{0.4f, 0.4f, 20.f, {0.6f, 0.6f, 0.6f}, false};
  std::vector<std::shared_ptr<const Mesh>> meshes;
  for (const char* name : {"cylinder", "bracket", "wrench", "socket"}) {
    const auto mesh = part_model(name, steel).mesh;
    // Each cut makes four of one: as many cuts as come nearest on a log scale.
    const double cuts =
        std::log(static_cast<double>(triangles) / static_cast<double>(mesh->triangles.size())) / std::log(4.0);
    meshes.push_back(subdivided(*mesh, mesh->triangles.size() << (2 * std::max(0L, std::lround(cuts)))));
  }
  for (int i = 0; i < parts; ++i) {
    const auto n = static_cast<std::uint64_t>(i);
    Pose X(Eigen::Quaterniond(draws.normal(8 * n), draws.normal(8 * n + 1), draws.normal(8 * n + 2),
                              draws.normal(8 * n + 3))
               .normalized());
    X.pretranslate(Vector3((draws.uniform(8 * n + 4) - 0.5) * 170, (draws.uniform(8 * n + 5) - 0.5) * 120,
                           790 - 50 * draws.uniform(8 * n + 6)));
    scene.objects.push_back({meshes[n % meshes.size()], X, static_cast<int>(n % meshes.size()) + 1});
  }
  Pose X_CB(Eigen::AngleAxisd(EIGEN_PI, Vector3(1, 0, 0)));
  X_CB.pretranslate(Vector3(0, 0, 810));
  scene.objects.push_back({bin_mesh({210, 160, 80}, 4, Surface{}), X_CB, 0});
  return scene;
}

// Nothing but the library: primary rays, and rays from the projector to what they met.
class BareEmbree {
 public:
  BareEmbree(const RenderScene& scene, const RenderRequest& request)
      : device_(rtcNewDevice(nullptr)),
        scene_(rtcNewScene(device_)),
        request_(request),
        rays_(ray_table(request.camera)) {
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    for (const SceneObject& object : scene.objects) {
      RTCScene tree = rtcNewScene(device_);
      rtcSetSceneFlags(tree, RTC_SCENE_FLAG_ROBUST);
      RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
      std::copy(object.mesh->vertices.begin(), object.mesh->vertices.end(),
                static_cast<Eigen::Vector3f*>(rtcSetNewGeometryBuffer(
                    geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, object.mesh->vertices.size())));
      std::copy(object.mesh->triangles.begin(), object.mesh->triangles.end(),
                static_cast<std::array<std::uint32_t, 3>*>(rtcSetNewGeometryBuffer(
                    geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, object.mesh->triangles.size())));
      rtcCommitGeometry(geometry);
      rtcAttachGeometry(tree, geometry);
      rtcCommitScene(tree);
      RTCGeometry instance = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_INSTANCE);
      rtcSetGeometryInstancedScene(instance, tree);
      const Eigen::Matrix<float, 3, 4> X = object.X_CO.matrix().topRows<3>().cast<float>();
      rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, X.data());
      rtcCommitGeometry(instance);
      rtcAttachGeometry(scene_, instance);
      rtcReleaseGeometry(geometry);
      rtcReleaseGeometry(instance);
      rtcReleaseScene(tree);
    }
    rtcCommitScene(scene_);
  }
  ~BareEmbree() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }

  void trace() const {
    const Eigen::Vector3f projector = request_.projector_xyz_mm->cast<float>();
    parallel_for(rays_.rows / 16, [&](int band) {
      alignas(64) RTCRayHit16 packet;
      alignas(64) int valid[16];
      std::fill(valid, valid + 16, -1);
      for (int r = band * 16; r < band * 16 + 16; r += 4) {
        for (int c = 0; c + 4 <= rays_.cols; c += 4) {
          for (int k = 0; k < 16; ++k) {
            const auto& ray = rays_.at<cv::Vec2f>(r + k / 4, c + k % 4);
            set(packet, k, Eigen::Vector3f::Zero(), {ray[0], ray[1], 1.f}, 1e30f);
          }
          ask(valid, packet);
          for (int k = 0; k < 16; ++k) {
            const auto& ray = rays_.at<cv::Vec2f>(r + k / 4, c + k % 4);
            const float z = std::min(packet.ray.tfar[k], 2000.f);
            set(packet, k, projector, Eigen::Vector3f(ray[0] * z, ray[1] * z, z) - projector, 0.9999f);
          }
          ask(valid, packet);
        }
      }
    });
  }

 private:
  static void set(RTCRayHit16& packet, int k, const Eigen::Vector3f& o, const Eigen::Vector3f& d, float far) {
    packet.ray.org_x[k] = o.x();
    packet.ray.org_y[k] = o.y();
    packet.ray.org_z[k] = o.z();
    packet.ray.dir_x[k] = d.x();
    packet.ray.dir_y[k] = d.y();
    packet.ray.dir_z[k] = d.z();
    packet.ray.tnear[k] = 0.f;
    packet.ray.tfar[k] = far;
    packet.ray.time[k] = 0.f;
    packet.ray.mask[k] = ~0u;
    packet.ray.flags[k] = 0;
    packet.hit.geomID[k] = packet.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
  }
  void ask(const int* valid, RTCRayHit16& packet) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    rtcIntersect16(valid, scene_, &context, &packet);
  }

  RTCDevice device_;
  RTCScene scene_;
  RenderRequest request_;
  cv::Mat rays_;
};

// Nothing but the library: the scene drawn twice with the smallest shaders that give ids, and read back.
class BareGl {
 public:
  BareGl(const RenderScene& scene, const RenderRequest& request) : scene_(scene), request_(request) {
    const OffscreenGl::Current current(gl_);
    program_ = OffscreenGl::program(
        "#version 450 core\nlayout(location=0) in vec3 p; uniform mat4 m; void main() { gl_Position = m * vec4(p, 1); "
        "}",
        "#version 450 core\nlayout(location=0) out uvec2 c; uniform uint o; void main() { c = uvec2(o, "
        "uint(gl_PrimitiveID)); }");
    glEnable(GL_DEPTH_TEST);
    for (const SceneObject& object : scene.objects) {
      unsigned array = 0, buffers[2];
      glGenVertexArrays(1, &array);
      glBindVertexArray(array);
      glGenBuffers(2, buffers);
      glBindBuffer(GL_ARRAY_BUFFER, buffers[0]);
      glBufferData(GL_ARRAY_BUFFER, static_cast<GLsizeiptr>(object.mesh->vertices.size() * 12),
                   object.mesh->vertices.data(), GL_STATIC_DRAW);
      glEnableVertexAttribArray(0);
      glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 0, nullptr);
      glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffers[1]);
      glBufferData(GL_ELEMENT_ARRAY_BUFFER, static_cast<GLsizeiptr>(object.mesh->triangles.size() * 12),
                   object.mesh->triangles.data(), GL_STATIC_DRAW);
      arrays_.push_back(array);
    }
  }

  void draw() {
    const OffscreenGl::Current current(gl_);
    pass(1.0, Vector3::Zero());
    pass(1.5, *request_.projector_xyz_mm);
  }

 private:
  void pass(double scale, const Vector3& from) {
    const int width = static_cast<int>(request_.camera.width * scale),
              height = static_cast<int>(request_.camera.height * scale);
    unsigned frame, targets[2];
    glGenFramebuffers(1, &frame);
    glGenRenderbuffers(2, targets);
    glBindFramebuffer(GL_FRAMEBUFFER, frame);
    glBindRenderbuffer(GL_RENDERBUFFER, targets[0]);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_RG32UI, width, height);
    glBindRenderbuffer(GL_RENDERBUFFER, targets[1]);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_DEPTH_COMPONENT32F, width, height);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, targets[0]);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, targets[1]);
    glViewport(0, 0, width, height);
    const unsigned nothing[4] = {0, 0, 0, 0};
    const float farthest = 1.f;
    glClearBufferuiv(GL_COLOR, 0, nothing);
    glClearBufferfv(GL_DEPTH, 0, &farthest);
    glUseProgram(program_);
    Eigen::Matrix4d clip = Eigen::Matrix4d::Zero();
    clip(0, 0) = 2 * request_.camera.fx / request_.camera.width;
    clip(1, 1) = 2 * request_.camera.fy / request_.camera.height;
    clip(0, 2) = from.x() / 800 * clip(0, 0);  // shifted so that the projector's picture shows the bin, too
    clip(2, 2) = 1;
    clip(2, 3) = -200;
    clip(3, 2) = 1;
    for (std::size_t i = 0; i < arrays_.size(); ++i) {
      const Eigen::Matrix4f m = (clip * (Eigen::Translation3d(-from) * scene_.objects[i].X_CO).matrix()).cast<float>();
      glUniformMatrix4fv(glGetUniformLocation(program_, "m"), 1, GL_FALSE, m.data());
      glUniform1ui(glGetUniformLocation(program_, "o"), static_cast<unsigned>(i + 1));
      glBindVertexArray(arrays_[i]);
      glDrawElements(GL_TRIANGLES, static_cast<int>(scene_.objects[i].mesh->triangles.size() * 3), GL_UNSIGNED_INT,
                     nullptr);
    }
    cv::Mat seen(height, width, CV_32SC2);
    glReadPixels(0, 0, width, height, GL_RG_INTEGER, GL_UNSIGNED_INT, seen.data);
    glDeleteFramebuffers(1, &frame);
    glDeleteRenderbuffers(2, targets);
  }

  OffscreenGl gl_;
  const RenderScene& scene_;
  RenderRequest request_;
  unsigned program_ = 0;
  std::vector<unsigned> arrays_;
};

struct Bench {
  int repeats = 7;
  SensorModel model;

  RenderRequest request(ChannelSet wanted) const {
    return {model.camera, model.projector_xyz_mm, model.reference_distance_mm, wanted};
  }
  CaptureContext context() const {
    CaptureContext c;
    c.camera = model.camera;
    c.projector_xyz_mm = model.projector_xyz_mm;
    c.reference_distance_mm = model.reference_distance_mm;
    c.depth_scale_mm = model.depth_scale_mm;
    c.frames = 1 << 30;
    return c;
  }

  void frame(const std::string& renderer_name, std::size_t triangles) const {
    const auto renderer = make_renderer(renderer_name);
    const RenderScene scene = bin_of(18, triangles);
    std::size_t all = 0;
    for (const SceneObject& object : scene.objects) all += object.mesh->triangles.size();
    const ChannelSet wanted = SensorRun::needed_channels(model, true);
    std::printf("\n%s, 18 parts of about %zu triangles and the bin: %zu triangles\n", renderer_name.c_str(), triangles,
                all);
    std::printf("  %-44s %8s %8s %9s  %s\n", "stage", "CPU ms", "2 cores", "wall ms", "share");

    SensorRun run(model, context());
    int number = 0;
    const Cost whole = measured(repeats, [&] {
      FrameInstant instant;
      instant.number = number++;
      run.frame(*renderer->render(scene, request(wanted)), instant);
    });
    const Cost render = measured(repeats, [&] { renderer->render(scene, request(wanted)); });
    const auto channels = renderer->render(scene, request(wanted));
    SensorRun again(model, context());
    number = 0;
    const Cost effects = measured(repeats, [&] {
      FrameInstant instant;
      instant.number = number++;
      again.frame(*channels, instant);
    });
    row("whole frame", whole, whole.cpu_ms);
    row("rendering", render, whole.cpu_ms);
    row("  depth alone (one picture)",
        measured(repeats, [&] { renderer->render(scene, request(static_cast<ChannelSet>(Channel::depth))); }),
        whole.cpu_ms);
    row("  depth, projector_gap (two pictures)",
        measured(repeats, [&] { renderer->render(scene, request(Channel::depth | Channel::projector_gap)); }),
        whole.cpu_ms);
    row("effects, storage, infra-red counts", effects, whole.cpu_ms);
    const SensorModel bare_model = [&] {
      SensorModel m = model;
      m.effects.clear();
      return m;
    }();
    const auto sensor_cost = [&](const SensorModel& m) {
      SensorRun one(m, context());
      int n = 0;
      return measured(repeats, [&] {
        FrameInstant instant;
        instant.number = n++;
        one.frame(*channels, instant);
      });
    };
    const Cost empty = sensor_cost(bare_model);
    double five = 0;
    for (const EffectInstance& effect : model.effects) {
      SensorModel one = bare_model;
      one.effects.push_back(effect);
      Cost cost = sensor_cost(one);
      cost.cpu_ms = std::max(0.0, cost.cpu_ms - empty.cpu_ms);
      cost.wall_ms = std::max(0.0, cost.wall_ms - empty.wall_ms);
      five += cost.cpu_ms;
      row("  " + effect.id, cost, whole.cpu_ms);
    }
    std::printf("  the five effects alone: %.1f ms CPU, %.1f ms on 2 cores\n", five, five / 2);

    if (renderer_name == "embree") {
      const BareEmbree bare(scene, request(wanted));
      const Cost cost = measured(repeats, [&] { bare.trace(); });
      row("bare rtcIntersect16, both pictures", cost);
      std::printf("  rendering / bare: %.2f\n", render.cpu_ms / cost.cpu_ms);
    } else {
      BareGl bare(scene, request(wanted));
      const Cost cost = measured(repeats, [&] { bare.draw(); });
      row("bare OpenGL, both pictures and reading back", cost);
      std::printf("  rendering / bare: %.2f\n", render.cpu_ms / cost.cpu_ms);
    }
  }

  void bare_fft() const {
    const int rows = model.camera.height, cols = model.camera.width;
    const NoiseSpectrum spectrum = NoiseSpectrum::parametric(rows, cols, 0.25, 1.2, 0.1);
    const NoiseSynthesis synthesis(spectrum);
    const Fft2 fft(rows, cols);
    std::vector<std::complex<float>> half(static_cast<std::size_t>(rows) * static_cast<std::size_t>(fft.half_cols()),
                                          {1.f, 0.f});
    cv::Mat noise(rows, cols, CV_32F);
    std::uint64_t key = 0;
    std::printf("\nnoise synthesis\n");
    const Cost own = measured(repeats, [&] { synthesis.synthesise(RandomStream(++key), noise); });
    const Cost bare = measured(repeats, [&] { fft.inverse(half, noise); });
    row("synthesis: phases and inverse DFT", own);
    row("bare fftwf c2r", bare);
    std::printf("  synthesis / bare: %.2f\n", own.cpu_ms / bare.cpu_ms);
  }

  void memory_floor() const {
    const std::size_t bytes = std::size_t{256} << 20;
    std::vector<char> a(bytes, 1), b(bytes, 2);
    const Cost copy = measured(repeats, [&] { std::copy(a.begin(), a.end(), b.begin()); });
    const double gb_s = 2e-9 * static_cast<double>(bytes) / (copy.wall_ms * 1e-3);
    const double pixels = static_cast<double>(model.camera.width) * model.camera.height;
    // What must be touched at least: depth 4, reason 1, noise 4, infra-red 4 + 2, normal 12, gap 4 bytes, written and
    // read.
    const double floor_ms = 2 * 31 * pixels / gb_s / 1e6;
    std::printf("\nmemory: %.1f GB/s copied; %.1f ms a frame for touching every layer once\n", gb_s, floor_ms);
  }

  void scaling(const std::string& renderer_name) const {
    const auto renderer = make_renderer(renderer_name);
    const ChannelSet wanted = SensorRun::needed_channels(model, true);
    const auto cost = [&](const RenderScene& scene, const Camera& camera) {
      RenderRequest r = request(wanted);
      r.camera = camera;
      return measured(std::min(repeats, 3), [&] { renderer->render(scene, r); }).cpu_ms;
    };
    std::printf("\n%s, rendering, CPU ms\n  pixels:   ", renderer_name.c_str());
    for (const int width : {320, 640, 1280, 2560}) {
      std::printf(" %d x %d %.0f;", width, width * 3 / 4,
                  cost(bin_of(18, 2000), model.camera.resized(width, width * 3 / 4)));
    }
    std::printf("\n  parts:    ");
    for (const int parts : {9, 18, 50, 100, 200})
      std::printf(" %d %.0f;", parts, cost(bin_of(parts, 2000), model.camera));
    std::printf("\n  triangles a part:");
    for (const std::size_t triangles : {2'000u, 20'000u, 200'000u}) {
      std::printf(" %zu k %.0f;", triangles / 1000, cost(bin_of(18, triangles), model.camera));
    }
    std::printf("\n");
  }
};
}  // namespace

int main(int argc, char** argv) {
  CLI::App app("One frame of an 18-part bin: stages, bare library calls, scaling");
  Bench bench;
  std::string renderers = "embree,osmesa";
  bool scaling = false;
  app.add_option("--repeats", bench.repeats)->check(CLI::Range(1, 1000));
  app.add_option("--renderer", renderers, "comma-separated");
  app.add_flag("--scaling", scaling);
  CLI11_PARSE(app, argc, argv);
  bench.model = read_sensor_model(std::string(BINRIG_SOURCE_DIR) + "/models/itri-2014.yaml", effect_catalogue());
  std::printf("%d x %d px, %d threads\n", bench.model.camera.width, bench.model.camera.height, jobs());
  bench.memory_floor();
  bench.bare_fft();
  std::stringstream list(renderers);
  for (std::string name; std::getline(list, name, ',');) {
    for (const std::size_t triangles : {2'000u, 20'000u}) bench.frame(name, triangles);
    if (scaling) bench.scaling(name);
  }
}
