// Non-convex parts collide as what they are: a few convex pieces instead of one hull.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/pose.h"
#include "sim/mesh.h"

namespace binrig {

/// The convex hull of `points`, grown by `radius_mm`: one point and a radius are a ball.
struct ConvexPiece {
  std::vector<Vector3> points;  ///< mm, frame O of the part
  double radius_mm = 0;
};

/// How well the union of the pieces stands for the mesh.
struct PiecesQuality {
  /// Furthest that a piece reaches outside the solid; the solid reaches outside the pieces by at most
  /// simplify_mm, for the cuts leave nothing out.
  double hausdorff_mm = 0;
  double volume_error = 0;  ///< (sum of the pieces' volumes - volume) / volume
};

struct ConvexPieces {
  std::vector<ConvexPiece> pieces;
  PiecesQuality quality;
};

struct DecompositionSettings {
  int most_pieces = 24;
  double excess_volume = 0.004;  ///< a piece is good enough if its hull adds at most this share of the part's volume
  double simplify_mm = 0.05;     ///< hulls drop vertices that matter less than this

  bool operator==(const DecompositionSettings&) const = default;
};

/// Cuts the solid by planes, always the piece whose hull adds most, always where the two hulls together add least.
/// Candidates are the planes of the faces at concave edges, the planes that halve those edges' angles, and slices along
/// the axes (compare Mamou and Ghorbel, "A simple and efficient approach for 3D mesh approximate convex decomposition",
/// ICIP 2009, who merge where we cut: cuts through concave edges give the few fat pieces that contacts like).
/// The mesh must have passed check_solid. Deterministic.
ConvexPieces convex_pieces(const Mesh& mesh, const DecompositionSettings& settings = {});

/// One piece: the convex hull of everything. For any mesh with volume, holes or not.
ConvexPieces hull_piece(const Mesh& mesh, const DecompositionSettings& settings = {});

/// convex_pieces, remembered on disk under the hash of vertices, triangles and settings ($XDG_CACHE_HOME/binrig/pieces,
/// else ~/.cache/...). A file that is not whole is made anew; a folder that cannot be written is no error.
ConvexPieces cached_convex_pieces(const Mesh& mesh, const DecompositionSettings& settings = {});

/// The quality of given pieces (hand-made ones, say), by samples on the pieces' surfaces about
/// 1.5 % of the part's size apart.
PiecesQuality pieces_quality(const Mesh& mesh, const std::vector<ConvexPiece>& pieces);

}  // namespace binrig
