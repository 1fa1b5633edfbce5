// Loops over pixels as wide as the machine can.
#pragma once

/// Before a function whose loops treat every pixel alone: it is compiled for eight pixels at a time, too, and the
/// machine chooses. No fused multiply-add, and no sums over pixels: the bytes are the same on every machine.
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && !defined(__SANITIZE_ADDRESS__)
#define BINRIG_WIDE __attribute__((target_clones("avx2", "default")))
#else
#define BINRIG_WIDE
#endif
