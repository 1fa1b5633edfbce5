// The same World from an SDFormat file (Gazebo's), read through libsdformat.
//
//   <world>   gravity; every <model> is one of:
//     a part    one <link> whose first <collision> is a mesh, box, cylinder or sphere. Static: lies at its pose.
//               Otherwise it falls into the first bin, from binrig's layout (its own pose is where Gazebo would begin).
//               Models of one geometry are one kind. <inertial><mass>, surface friction (mu) and bounce are taken.
//     the bin   <static> with <binrig:bin><binrig:inner_size>0.21 0.16 0.08</binrig:inner_size><binrig:wall>0.004
//               </binrig:wall></binrig:bin>; its own links are for Gazebo
//     the table <static> with a <plane>: the plane z = height
//     a camera  a link with a <sensor> of type camera, depth_camera or rgbd_camera
// SDFormat's metres become millimetres, its camera axes (x forward, z up) ours (z forward, y down).
#pragma once

#include <string>

#include "sim/world.h"

namespace binrig {

/// True for *.sdf and *.world. read_world passes such files on.
bool is_sdf(const std::string& path);

/// Throws one Error with every violation: what libsdformat says of the file (unknown elements among it, with line),
/// missing meshes, geometries and sensors that the World does not know, and what check_physics finds. A program built
/// without libsdformat says so.
World read_sdf_world(const std::string& path);

}  // namespace binrig
