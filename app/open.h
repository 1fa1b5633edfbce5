// The one place that knows all schemes: from a URI to a source, a bin, or a cell of both.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/bin.h"
#include "core/frame_source.h"

namespace binrig {

/// replay:SET[#split/id][?rate=real|max&loop=0|1]     a recording (all captures in turn without #)
/// sim:SET?model=M.yaml[&seed=N][#split/id]            the scenes of a recording set, simulated
/// Throws Error for an unknown scheme or option (listing the known ones), or what the source itself throws.
std::unique_ptr<FrameSource> open_source(const std::string& uri);

/// Schemes that open_source knows, with a line about each.
struct Scheme {
  std::string pattern, meaning;
};
std::vector<Scheme> source_schemes();

}  // namespace binrig
