// Ray casting with Embree 3: one instance per object, one cached tree per mesh.
#include <memory>

#include <embree3/rtcore.h>
#include <opencv2/core.hpp>

#include "core/error.h"
#include "core/parallel.h"
#include "core/recently_made.h"
#include "sim/shading.h"

namespace binrig {

namespace {
constexpr int tile_rows = 4, tile_cols = 4;  // one packet
constexpr int lanes = tile_rows * tile_cols;
constexpr int band_tiles = 2;
constexpr std::size_t cached_meshes = 128;

// Reference-counted Embree objects.
struct SceneRelease {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
using ScenePointer = std::shared_ptr<std::remove_pointer_t<RTCScene>>;
ScenePointer own(RTCScene scene) { return ScenePointer(scene, SceneRelease{}); }

[[noreturn]] void fail(RTCDevice device, const std::string& what) {
  throw Error("Embree: " + what + " (error code " + std::to_string(rtcGetDeviceError(device)) + ").");
}

// One device and one cache for the process: trees are read-only once built.
class Trees {
 public:
  static Trees& instance() {
    static Trees trees;
    return trees;
  }
  RTCDevice device() const { return device_.get(); }

  ScenePointer of(const Mesh& mesh) {
    const std::uint64_t key = mesh.content_hash != 0 ? mesh.content_hash : hash_of(mesh);
    return trees_.get(key, [&] { return build(mesh); });
  }

 private:
  Trees() : device_(rtcNewDevice(nullptr), rtcReleaseDevice) {
    if (!device_) fail(nullptr, "no device");
  }

  ScenePointer build(const Mesh& mesh) {
    ScenePointer scene = own(rtcNewScene(device()));
    // Robust: no ray slips between two triangles that share an edge.
    rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
    RTCGeometry geometry = rtcNewGeometry(device(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<Eigen::Vector3f*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Eigen::Vector3f), mesh.vertices.size()));
    auto* triangles = static_cast<std::array<std::uint32_t, 3>*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, sizeof mesh.triangles[0], mesh.triangles.size()));
    if (!vertices || !triangles) {
      rtcReleaseGeometry(geometry);
      fail(device(), "no memory for " + mesh.name);
    }
    std::copy(mesh.vertices.begin(), mesh.vertices.end(), vertices);
    std::copy(mesh.triangles.begin(), mesh.triangles.end(), triangles);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene.get(), geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene.get());
    return scene;
  }

  const std::unique_ptr<std::remove_pointer_t<RTCDevice>, decltype(&rtcReleaseDevice)> device_;  // outlives the trees
  RecentlyMade<std::uint64_t, ScenePointer> trees_{cached_meshes};
};

// Calls body(first row, first column) for every tile of a rows x cols image, in parallel.
template <typename Body>
void for_tiles(int rows, int cols, const Body& body) {
  const int band = tile_rows * band_tiles;
  parallel_for((rows + band - 1) / band, [&](int b) {
    for (int row = b * band; row < std::min(rows, (b + 1) * band); row += tile_rows) {
      for (int col = 0; col < cols; col += tile_cols) body(row, col);
    }
  });
}

class RayCasting final : public Visibility {
 public:
  explicit RayCasting(const RenderScene& scene) {
    Trees& trees = Trees::instance();
    scene_ = own(rtcNewScene(trees.device()));
    rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST);
    for (std::size_t i = 0; i < scene.objects.size(); ++i) {
      const SceneObject& object = scene.objects[i];
      RTCGeometry geometry = rtcNewGeometry(trees.device(), RTC_GEOMETRY_TYPE_INSTANCE);
      trees_.push_back(trees.of(*object.mesh));
      rtcSetGeometryInstancedScene(geometry, trees_.back().get());
      const Eigen::Matrix<float, 3, 4> X = object.X_CO.matrix().topRows<3>().cast<float>();  // column-major
      rtcSetGeometryTransform(geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, X.data());
      rtcCommitGeometry(geometry);
      rtcAttachGeometryByID(scene_.get(), geometry, static_cast<unsigned>(i));
      rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(scene_.get());
    const RTCError error = rtcGetDeviceError(trees.device());
    if (error != RTC_ERROR_NONE) throw Error("Embree: the scene cannot be built, code " + std::to_string(error) + ".");
  }

  FirstHits first_hits(const cv::Mat& rays) override {
    FirstHits hits{cv::Mat(rays.size(), CV_16U), cv::Mat(rays.size(), CV_32S)};
    for_tiles(rays.rows, rays.cols, [&](int row, int col) {
      Packet packet;
      for (int k = 0; k < lanes; ++k) {
        const int r = row + k / tile_cols, c = col + k % tile_cols;
        const bool there = r < rays.rows && c < rays.cols;
        const cv::Vec2f ray = there ? rays.at<cv::Vec2f>(r, c) : cv::Vec2f(0.f, 0.f);
        packet.set(k, there, Eigen::Vector3f::Zero(), {ray[0], ray[1], 1.f}, std::numeric_limits<float>::infinity());
      }
      packet.trace(scene_.get());
      for (int k = 0; k < lanes; ++k) {
        if (!packet.valid[k]) continue;
        const int r = row + k / tile_cols, c = col + k % tile_cols;
        const bool hit = packet.hit(k);
        hits.object.at<std::uint16_t>(r, c) = static_cast<std::uint16_t>(hit ? packet.rays.hit.instID[0][k] + 1 : 0);
        hits.triangle.at<std::int32_t>(r, c) = hit ? static_cast<std::int32_t>(packet.rays.hit.primID[k]) : -1;
      }
    });
    return hits;
  }

  cv::Mat gaps(const Vector3& light_mm, const cv::Mat& rays, const cv::Mat& depth_mm, const FirstHits&) override {
    cv::Mat gap = cv::Mat::zeros(rays.size(), CV_32F);
    const Eigen::Vector3f light = light_mm.cast<float>();
    for_tiles(rays.rows, rays.cols, [&](int row, int col) {
      Packet packet;
      float length[lanes];
      bool any = false;
      for (int k = 0; k < lanes; ++k) {
        const int r = row + k / tile_cols, c = col + k % tile_cols;
        const bool inside = r < rays.rows && c < rays.cols;
        const float z = inside ? depth_mm.at<float>(r, c) : 0.f;
        const cv::Vec2f ray = inside ? rays.at<cv::Vec2f>(r, c) : cv::Vec2f(0.f, 0.f);
        const Eigen::Vector3f along = Eigen::Vector3f(ray[0] * z, ray[1] * z, z) - light;
        length[k] = along.norm();
        const bool there = z > 0.f && length[k] > lit_within_mm;
        any = any || there;
        packet.set(k, there, light, along, there ? 1.f - lit_within_mm / length[k] : 0.f);
      }
      if (!any) return;
      packet.trace(scene_.get());
      for (int k = 0; k < lanes; ++k) {
        if (!packet.valid[k] || !packet.hit(k)) continue;
        gap.at<float>(row + k / tile_cols, col + k % tile_cols) = length[k] * (1.f - packet.rays.ray.tfar[k]);
      }
    });
    return gap;
  }

 private:
  struct alignas(64) Packet {
    RTCRayHit16 rays;
    alignas(64) int valid[lanes];
    void set(int k, bool there, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction, float far) {
      valid[k] = there ? -1 : 0;
      rays.ray.org_x[k] = origin.x();
      rays.ray.org_y[k] = origin.y();
      rays.ray.org_z[k] = origin.z();
      rays.ray.dir_x[k] = direction.x();
      rays.ray.dir_y[k] = direction.y();
      rays.ray.dir_z[k] = direction.z();
      rays.ray.tnear[k] = 0.f;
      rays.ray.tfar[k] = far;
      rays.ray.time[k] = 0.f;
      rays.ray.mask[k] = ~0u;
      rays.ray.id[k] = 0;
      rays.ray.flags[k] = 0;
      rays.hit.geomID[k] = RTC_INVALID_GEOMETRY_ID;
      rays.hit.instID[0][k] = RTC_INVALID_GEOMETRY_ID;
    }
    void trace(RTCScene scene) {
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      rtcIntersect16(valid, scene, &context, &rays);
    }
    bool hit(int k) const { return rays.hit.geomID[k] != RTC_INVALID_GEOMETRY_ID; }
  };

  std::vector<ScenePointer> trees_;
  ScenePointer scene_;
};

class EmbreeRenderer final : public Renderer {
 public:
  std::string name() const override { return "embree"; }
  std::shared_ptr<const Channels> render(const RenderScene& scene, const RenderRequest& request) const override {
    RayCasting casting(scene);
    return render_channels(scene, request, casting);
  }
};
}  // namespace

std::unique_ptr<Renderer> make_embree_renderer() { return std::make_unique<EmbreeRenderer>(); }

}  // namespace binrig
