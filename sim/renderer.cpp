#include "sim/renderer.h"

#include "core/error.h"
#include "sim/shading.h"

namespace binrig {

namespace {
// Embree is the faster one on CPUs by measurement (bench/render_bench).
class AutoRenderer final : public Renderer {
 public:
  std::string name() const override { return "auto"; }
  std::shared_ptr<const Channels> render(const RenderScene& scene, const RenderRequest& request) const override {
    return (scene.objects.empty() && scene.plane ? plane_ : meshes_)->render(scene, request);
  }

 private:
  std::unique_ptr<Renderer> plane_ = make_plane_renderer(), meshes_ = make_embree_renderer();
};
}  // namespace

std::unique_ptr<Renderer> make_renderer(const std::string& name) {
  if (name == "auto") return std::make_unique<AutoRenderer>();
  if (name == "plane") return make_plane_renderer();
  if (name == "embree") return make_embree_renderer();
  if (name == "osmesa") return make_osmesa_renderer();
  const std::string near = nearest_word(name, {"auto", "embree", "osmesa", "plane"});
  throw Error("There is no renderer \"" + name + "\": auto, embree, osmesa or plane" +
              (near.empty() ? "" : "; did you mean " + near + "?"));
}

}  // namespace binrig
