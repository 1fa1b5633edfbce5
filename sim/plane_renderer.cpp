// The backdrop alone: no mesh, so nothing to find and nothing to cast a shadow.
#include <opencv2/core.hpp>

#include "core/error.h"
#include "sim/shading.h"

namespace binrig {

namespace {
class NoMeshes final : public Visibility {
 public:
  FirstHits first_hits(const cv::Mat&) override { return {}; }
  cv::Mat gaps(const Vector3&, const cv::Mat&, const cv::Mat& depth_mm, const FirstHits&) override {
    return cv::Mat::zeros(depth_mm.size(), CV_32F);
  }
};

class PlaneRenderer final : public Renderer {
 public:
  std::string name() const override { return "plane"; }
  std::shared_ptr<const Channels> render(const RenderScene& scene, const RenderRequest& request) const override {
    if (!scene.objects.empty() || !scene.plane) {
      throw Error("The renderer \"plane\" renders one plane and nothing else: use embree or osmesa for meshes.");
    }
    NoMeshes none;
    return render_channels(scene, request, none);
  }
};
}  // namespace

std::unique_ptr<Renderer> make_plane_renderer() { return std::make_unique<PlaneRenderer>(); }

}  // namespace binrig
