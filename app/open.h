// The one place that knows all schemes: from a URI to a source, a bin, or a cell of both.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/bin.h"
#include "core/frame_source.h"

namespace binrig {

/// Throws Error for an unknown scheme or option (listing the known ones), or what the source itself throws.
std::unique_ptr<FrameSource> open_source(const std::string& uri);

/// sim:WORLD.yaml[?bin=N&seed=N]. Throws Error likewise.
std::unique_ptr<Bin> open_bin(const std::string& uri);

/// Sources and bins of one world: what a bin does, the next frame shows.
struct Cell {
  std::vector<std::unique_ptr<FrameSource>> sources;  ///< one for each sensor of the world
  std::vector<std::unique_ptr<Bin>> bins;
};
/// sim:WORLD.yaml[?model=M.yaml&seed=N]. Throws Error likewise; a recording has no bin to command.
Cell open_cell(const std::string& uri);

/// Schemes that open_source knows, with a line about each.
struct Scheme {
  std::string pattern, meaning;
};
std::vector<Scheme> source_schemes();

}  // namespace binrig
