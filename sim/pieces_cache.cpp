// The cache of convex pieces on disk: one small file of text per mesh and settings.
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <fmt/format.h>
#include <unistd.h>

#include "core/random.h"
#include "sim/convex_pieces.h"

namespace binrig {
namespace fs = std::filesystem;
namespace {

// Belongs to the key: raise it when the cutting changes.
constexpr int version = 1;

fs::path cache_folder() {
  if (const char* xdg = std::getenv("XDG_CACHE_HOME"); xdg && *xdg) return fs::path(xdg) / "binrig" / "pieces";
  if (const char* home = std::getenv("HOME"); home && *home) return fs::path(home) / ".cache" / "binrig" / "pieces";
  return {};
}

std::uint64_t hash_bytes(const void* data, std::size_t size, std::uint64_t basis) {
  return hash_text({static_cast<const char*>(data), size}, basis);
}

std::string key_of(const Mesh& mesh, const DecompositionSettings& settings) {
  std::uint64_t hash = hash_text(
      fmt::format("{} {} {} {}", version, settings.most_pieces, settings.excess_volume, settings.simplify_mm));
  hash = hash_bytes(mesh.vertices.data(), mesh.vertices.size() * sizeof(mesh.vertices[0]), hash);
  hash = hash_bytes(mesh.triangles.data(), mesh.triangles.size() * sizeof(mesh.triangles[0]), hash);
  return fmt::format("{:016x}", hash);
}

std::string to_text(const ConvexPieces& pieces) {
  std::string text =
      fmt::format("{:a} {:a} {}\n", pieces.quality.hausdorff_mm, pieces.quality.volume_error, pieces.pieces.size());
  for (const ConvexPiece& piece : pieces.pieces) {
    text += fmt::format("{:a} {}\n", piece.radius_mm, piece.points.size());
    for (const Vector3& p : piece.points) text += fmt::format("{:a} {:a} {:a}\n", p.x(), p.y(), p.z());
  }
  return text;
}

/// Streams do not read hexadecimal floats; strtod does.
double read_number(std::istream& in) {
  std::string word;
  in >> word;
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  if (word.empty() || *end != '\0') in.setstate(std::ios::failbit);
  return value;
}

bool from_text(const std::string& text, ConvexPieces& pieces) {
  std::istringstream in(text);
  std::size_t count = 0;
  pieces.quality.hausdorff_mm = read_number(in);
  pieces.quality.volume_error = read_number(in);
  in >> count;
  for (std::size_t i = 0; in && i < count; ++i) {
    ConvexPiece piece;
    std::size_t points = 0;
    piece.radius_mm = read_number(in);
    in >> points;
    for (std::size_t k = 0; in && k < points; ++k) {
      const double x = read_number(in), y = read_number(in), z = read_number(in);
      piece.points.emplace_back(x, y, z);
    }
    pieces.pieces.push_back(std::move(piece));
  }
  return static_cast<bool>(in) && count > 0;
}

}  // namespace

ConvexPieces cached_convex_pieces(const Mesh& mesh, const DecompositionSettings& settings) {
  const fs::path folder = cache_folder();
  if (folder.empty()) return convex_pieces(mesh, settings);
  const fs::path file = folder / (key_of(mesh, settings) + ".txt");
  // First line: hash of the rest, so that half a file is seen to be one.
  if (std::ifstream in(file); in) {
    std::string hash;
    std::getline(in, hash);
    std::ostringstream rest;
    rest << in.rdbuf();
    ConvexPieces pieces;
    if (hash == fmt::format("{:016x}", hash_text(rest.str())) && from_text(rest.str(), pieces)) return pieces;
  }
  const ConvexPieces pieces = convex_pieces(mesh, settings);
  std::error_code ignored;
  fs::create_directories(folder, ignored);
  const fs::path scratch = folder / fmt::format("{}.{}.part", file.filename().string(), ::getpid());
  const std::string text = to_text(pieces);
  {
    std::ofstream out(scratch);
    out << fmt::format("{:016x}", hash_text(text)) << '\n' << text;
    out.flush();
    if (!out) {
      fs::remove(scratch, ignored);
      return pieces;
    }
  }
  fs::rename(scratch, file, ignored);
  if (ignored) fs::remove(scratch, ignored);
  return pieces;
}

}  // namespace binrig
