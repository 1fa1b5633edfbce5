// The page's style sheet and scripts.
#pragma once

namespace binrig {

extern const char* const page_style;
/// Reads values under the pointer, wipes two maps, turns point clouds. Expects binrigScales (name -> 256 colours
/// "rrggbb").
extern const char* const page_script;

}  // namespace binrig
