// The catalogue of effects as a page of the documentation, made from the declarations alone.
#pragma once

#include <string>

namespace binrig {

/// Writes `folder`/effects.md and one picture per effect in `folder`/effects/: a plane and a bin without and with it.
/// Throws Error if the folder cannot be written.
void write_effects_page(const std::string& folder);

}  // namespace binrig
