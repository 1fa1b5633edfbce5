// Arithmetic on pixels that the compiler can vectorise, where the library's function would cost more than the effect.
#pragma once

#include <cmath>

namespace binrig {

/// sin(2 pi t), to 4e-6, for |t| < 2^31. A fraction of a turn is what banding and pixel locking count in.
inline float sin_turns(float t) {
  const float whole = static_cast<float>(static_cast<int>(t + (t >= 0.f ? 0.5f : -0.5f)));
  const float r = t - whole;                                     // -1/2 .. 1/2
  const float folded = 0.25f - std::fabs(std::fabs(r) - 0.25f);  // 0 .. 1/4, the same sine
  const float x = 6.28318531f * folded, x2 = x * x;
  const float s = x * (1.f - x2 * (1.f / 6.f - x2 * (1.f / 120.f - x2 * (1.f / 5040.f - x2 * (1.f / 362880.f)))));
  return std::copysign(s, r);
}

/// Nearest whole number, halves away from zero, for |x| < 2^31.
inline float rounded(float x) { return static_cast<float>(static_cast<int>(x + (x >= 0.f ? 0.5f : -0.5f))); }

}  // namespace binrig
