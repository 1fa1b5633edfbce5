#include "sim/mesh.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <unordered_map>

#include <assimp/config.h>
#include <assimp/material.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <assimp/Importer.hpp>

#include "core/error.h"
#include "core/random.h"

namespace binrig {

namespace {
constexpr std::size_t most_triangles = 4'000'000;
constexpr double least_diameter_mm = 1, largest_diameter_mm = 20'000;

double mm_per(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm:
      return 1;
    case LengthUnit::cm:
      return 10;
    case LengthUnit::m:
      return 1000;
    case LengthUnit::inch:
      return 25.4;
  }
  return 1;
}

struct VectorHash {
  std::size_t operator()(const std::array<float, 3>& v) const {
    return hash_text({reinterpret_cast<const char*>(v.data()), sizeof v});
  }
};

// Merges vertices at equal places, so that neighbouring triangles share them whatever the format says.
class Builder {
 public:
  std::uint32_t vertex(const Eigen::Vector3f& p) {
    // + 0 turns -0 into 0: equal places, equal bytes.
    const auto [it, is_new] = index_.try_emplace({p.x() + 0.f, p.y() + 0.f, p.z() + 0.f}, mesh.vertices.size());
    if (is_new) mesh.vertices.push_back(p);
    return it->second;
  }
  Mesh mesh;

 private:
  std::unordered_map<std::array<float, 3>, std::uint32_t, VectorHash> index_;
};

Surface surface_of_material(const aiMaterial& material) {
  Surface surface;
  surface.assumed = true;
  aiColor3D colour;
  if (material.Get(AI_MATKEY_COLOR_DIFFUSE, colour) == AI_SUCCESS) surface.rgb = {colour.r, colour.g, colour.b};
  return surface;
}

Eigen::Vector3f placed(const aiMatrix4x4& X, const aiVector3D& p, double scale) {
  return {static_cast<float>((double{X.a1} * p.x + double{X.a2} * p.y + double{X.a3} * p.z + X.a4) * scale),
          static_cast<float>((double{X.b1} * p.x + double{X.b2} * p.y + double{X.b3} * p.z + X.b4) * scale),
          static_cast<float>((double{X.c1} * p.x + double{X.c2} * p.y + double{X.c3} * p.z + X.c4) * scale)};
}

void gather(const aiScene& scene, const aiNode& node, const aiMatrix4x4& X_parent, double scale, Builder& builder,
            std::size_t& bad_vertices) {
  const aiMatrix4x4 X = X_parent * node.mTransformation;
  for (unsigned m = 0; m < node.mNumMeshes; ++m) {
    const aiMesh& part = *scene.mMeshes[node.mMeshes[m]];
    std::vector<std::uint32_t> index(part.mNumVertices);
    for (unsigned v = 0; v < part.mNumVertices; ++v) {
      const Eigen::Vector3f p = placed(X, part.mVertices[v], scale);
      if (!p.allFinite()) {
        ++bad_vertices;
        continue;
      }
      index[v] = builder.vertex(p);
    }
    for (unsigned f = 0; f < part.mNumFaces; ++f) {
      const aiFace& face = part.mFaces[f];
      if (face.mNumIndices != 3) continue;  // points and lines
      const std::array<std::uint32_t, 3> triangle{index[face.mIndices[0]], index[face.mIndices[1]],
                                                  index[face.mIndices[2]]};
      if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0]) continue;
      builder.mesh.triangles.push_back(triangle);
      builder.mesh.triangle_surface.push_back(static_cast<std::uint16_t>(part.mMaterialIndex));
    }
  }
  for (unsigned c = 0; c < node.mNumChildren; ++c) {
    gather(scene, *node.mChildren[c], X, scale, builder, bad_vertices);
  }
}

// Assimp's PLY reader loops for ever on a header without an end.
bool is_endless_ply(const std::string& path, const std::string& ending) {
  if (ending != ".ply") return false;
  std::ifstream file(path, std::ios::binary);
  std::string head(1 << 16, '\0');
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  return head.find("end_header\n") == std::string::npos && head.find("end_header\r") == std::string::npos;
}

[[noreturn]] void refuse(const std::string& path, const std::string& message) {
  Violations violations;
  violations.add(path, "", message);
  throw Error("This mesh cannot be used.", violations.list());
}
}  // namespace

void Mesh::bounds(Eigen::Vector3f& low, Eigen::Vector3f& high) const {
  low.setZero();
  high.setZero();
  if (vertices.empty()) return;
  low = high = vertices.front();
  for (const auto& v : vertices) {
    low = low.cwiseMin(v);
    high = high.cwiseMax(v);
  }
}

std::uint64_t hash_of(const Mesh& mesh) {
  const std::uint64_t vertices =
      hash_text({reinterpret_cast<const char*>(mesh.vertices.data()), mesh.vertices.size() * sizeof(Eigen::Vector3f)});
  return hash_text({reinterpret_cast<const char*>(mesh.triangles.data()), mesh.triangles.size() * 12}, vertices) | 1u;
}

std::shared_ptr<const Mesh> load_mesh(const std::string& path, LengthUnit unit) {
  if (!std::filesystem::is_regular_file(path)) refuse(path, "there is no such file");
  std::string ending = std::filesystem::path(path).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(), [](unsigned char c) { return std::tolower(c); });
  if (is_endless_ply(path, ending)) refuse(path, "cannot be read: its PLY header has no end");
  Assimp::Importer importer;
  importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE, aiPrimitiveType_POINT | aiPrimitiveType_LINE);
  importer.SetPropertyBool(AI_CONFIG_IMPORT_COLLADA_IGNORE_UP_DIRECTION, true);  // O is the file's own frame
  const aiScene* scene = importer.ReadFile(path, aiProcess_Triangulate);
  if (!scene || !scene->mRootNode) refuse(path, std::string("cannot be read: ") + importer.GetErrorString());

  std::size_t faces = 0;
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) faces += scene->mMeshes[m]->mNumFaces;
  if (faces > most_triangles) {
    refuse(path, "has " + std::to_string(faces) + " triangles: simplify it to " + std::to_string(most_triangles) +
                     " at most");
  }
  Builder builder;
  std::size_t bad_vertices = 0;
  // A COLLADA file states its unit, and Assimp turns it into metres.
  const double scale = mm_per(ending == ".dae" ? LengthUnit::m : unit);
  gather(*scene, *scene->mRootNode, aiMatrix4x4(), scale, builder, bad_vertices);
  if (bad_vertices > 0)
    refuse(path, std::to_string(bad_vertices) + " of its vertices are not numbers (NaN or infinite)");
  Mesh& mesh = builder.mesh;
  if (mesh.triangles.empty()) refuse(path, "has no triangles");

  Eigen::Vector3f low, high;
  mesh.bounds(low, high);
  const double diameter = (high - low).cast<double>().norm();
  if (diameter < least_diameter_mm) {
    refuse(path, "is " + number_text(diameter) + " mm across: is it in metres? Say unit: m");
  }
  if (diameter > largest_diameter_mm) {
    refuse(path, "is " + number_text(diameter / 1000) + " m across: is its unit smaller than the one given?");
  }
  if (scene->mNumMaterials > 0) {
    mesh.surfaces.clear();
    for (unsigned m = 0; m < scene->mNumMaterials; ++m) {
      mesh.surfaces.push_back(surface_of_material(*scene->mMaterials[m]));
    }
  } else {
    mesh.triangle_surface.clear();
    mesh.surfaces.front().assumed = true;
  }
  mesh.name = path;
  mesh.content_hash = hash_of(mesh);
  return std::make_shared<const Mesh>(std::move(mesh));
}

std::shared_ptr<const Mesh> rectangle_mesh(double width_mm, double height_mm, const Surface& surface) {
  Mesh mesh;
  const auto x = static_cast<float>(width_mm / 2), y = static_cast<float>(height_mm / 2);
  mesh.vertices = {{-x, -y, 0}, {x, -y, 0}, {x, y, 0}, {-x, y, 0}};
  mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  mesh.surfaces = {surface};
  mesh.name = "rectangle";
  mesh.content_hash = hash_of(mesh);
  return std::make_shared<const Mesh>(std::move(mesh));
}

std::shared_ptr<const Mesh> box_mesh(const Eigen::Vector3d& size_mm, const Surface& surface) {
  Mesh mesh;
  const Eigen::Vector3f half = (size_mm / 2).cast<float>();
  for (int corner = 0; corner < 8; ++corner) {
    mesh.vertices.push_back(
        {corner & 1 ? half.x() : -half.x(), corner & 2 ? half.y() : -half.y(), corner & 4 ? half.z() : -half.z()});
  }
  mesh.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                    {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  mesh.surfaces = {surface};
  mesh.name = "box";
  mesh.content_hash = hash_of(mesh);
  return std::make_shared<const Mesh>(std::move(mesh));
}

}  // namespace binrig
