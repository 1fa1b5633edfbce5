// Step by step on standard error, for those who ask why (docs/diagnosis.md).
#pragma once

#include <cstdlib>

namespace binrig {

/// True where BINRIG_TRACE is set.
inline bool tracing() { return std::getenv("BINRIG_TRACE") != nullptr; }

}  // namespace binrig
