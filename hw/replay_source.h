// A recording served as if it were the camera.
#pragma once

#include <memory>

#include "core/frame_source.h"
#include "core/uri.h"

namespace binrig {

/// replay:SET[#split/id][?rate=real|max&loop=0|1]. Without a capture, all captures follow one another in the set's
/// order. rate=real keeps the recorded times between frames (max: as fast as they are read, the default); loop=1 begins
/// again at the end (an endless source). A frame that cannot be read is thrown as Error by next(), which names it; the
/// call after that goes on with the next frame.
std::unique_ptr<FrameSource> open_replay(Uri uri);

}  // namespace binrig
