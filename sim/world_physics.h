// What physics needs of a world: bodies of its parts, boxes of its bins, and what cannot be stacked.
#pragma once

#include <vector>

#include "core/error.h"
#include "sim/stacking.h"
#include "sim/world.h"

namespace binrig {

/// Of every part that falls into a bin: whether it is a solid, whether its density (given, or made by its mass) is one
/// of a material, whether it fits into its bins. A part whose mesh is missing is passed over: that has been said.
void check_physics(const World& world, Violations& violations);

/// The part as physics knows it. Throws Error if the mesh is no solid, or if most_pieces convex pieces still miss it by
/// more than 2 % of its size.
Body body_of(const WorldPart& part);

BinBox box_of(const WorldBin& bin);

}  // namespace binrig
