#include "core/random.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include "core/error.h"
#include "core/parallel.h"

namespace binrig {
namespace {

// Philox-4x32-10 of `wide` counters in a row: word[w][i] of counter + i, one loop after another that vectorises.
template <int wide>
struct Blocks {
  std::uint32_t word[4][wide];
};

template <int wide>
inline Blocks<wide> philox(std::uint64_t key, std::uint64_t counter) {
  Blocks<wide> blocks{};
  auto& [c0, c1, c2, c3] = blocks.word;
  for (int i = 0; i < wide; ++i) {
    const std::uint64_t own = counter + static_cast<std::uint64_t>(i);
    c0[i] = static_cast<std::uint32_t>(own);
    c1[i] = static_cast<std::uint32_t>(own >> 32);
  }
  std::uint32_t k0 = static_cast<std::uint32_t>(key), k1 = static_cast<std::uint32_t>(key >> 32);
  for (int round = 0; round < 10; ++round) {
    for (int i = 0; i < wide; ++i) {
      const std::uint64_t p0 = 0xD2511F53ull * c0[i], p1 = 0xCD9E8D57ull * c2[i];
      const std::uint32_t n0 = static_cast<std::uint32_t>(p1 >> 32) ^ c1[i] ^ k0;
      const std::uint32_t n2 = static_cast<std::uint32_t>(p0 >> 32) ^ c3[i] ^ k1;
      c1[i] = static_cast<std::uint32_t>(p1);
      c3[i] = static_cast<std::uint32_t>(p0);
      c0[i] = n0;
      c2[i] = n2;
    }
    k0 += 0x9E3779B9u;
    k1 += 0xBB67AE85u;
  }
  return blocks;
}

struct Block {
  std::uint32_t word[4];
};

inline Block philox(std::uint64_t key, std::uint64_t counter) {
  const Blocks<1> one = philox<1>(key, counter);
  return {{one.word[0][0], one.word[1][0], one.word[2][0], one.word[3][0]}};
}

inline double unit53(std::uint32_t high, std::uint32_t low) {
  return static_cast<double>(((static_cast<std::uint64_t>(high) << 32) | low) >> 11) * 0x1.0p-53;
}

constexpr double two_pi = 6.283185307179586476925;
constexpr int wide = 16;  // blocks drawn side by side

}  // namespace

std::uint64_t hash_text(std::string_view text, std::uint64_t basis) {
  std::uint64_t hash = basis;
  for (unsigned char c : text) hash = (hash ^ c) * 1099511628211ull;
  return hash;
}

std::uint64_t mix_keys(std::uint64_t a, std::uint64_t b) {
  std::uint64_t z = a + 0x9E3779B97F4A7C15ull + (b ^ (b >> 32)) * 0xD1342543DE82EF95ull;  // splitmix64's finaliser
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
  return z ^ (z >> 31);
}

std::uint64_t RandomStream::bits(std::uint64_t index) const {
  const Block b = philox(key_, index);
  return (static_cast<std::uint64_t>(b.word[0]) << 32) | b.word[1];
}

double RandomStream::uniform(std::uint64_t index) const {
  const Block b = philox(key_, index);
  return unit53(b.word[0], b.word[1]);
}

double RandomStream::normal(std::uint64_t index) const {
  const Block b = philox(key_, index);
  const double u = 1.0 - unit53(b.word[0], b.word[1]);  // in (0, 1]
  return std::sqrt(-2.0 * std::log(u)) * std::cos(two_pi * unit53(b.word[2], b.word[3]));
}

namespace {

// Calls body(row) for every row of a CV_32F image; rows are independent, so threads change nothing.
template <typename Body>
void for_rows(const char* what, cv::Mat& image, Body body) {
  if (image.type() != CV_32F) throw Error(std::string(what) + " needs a CV_32F image");
  parallel_for(image.rows, [&](int row) { body(image.ptr<float>(row), static_cast<std::uint64_t>(row)); });
}

}  // namespace

void RandomStream::fill_normal(cv::Mat& image) const {
  using Draws = Eigen::Array<float, wide, 1>;
  const int cols = image.cols;
  const std::uint64_t blocks = static_cast<std::uint64_t>(cols + 1) / 2;
  const std::uint64_t key = mix_keys(key_, 1);
  for_rows("fill_normal", image, [&](float* out, std::uint64_t row) {
    Draws u, angle;
    for (int col = 0; col < cols; col += 2 * wide) {
      const Blocks<wide> b = philox<wide>(key, row * blocks + static_cast<std::uint64_t>(col / 2));
      for (int i = 0; i < wide; ++i) {
        u[i] = (static_cast<float>(b.word[0][i] >> 8) + 1.f) * 0x1.0p-24f;  // in (0, 1]; 2^-24 reaches 5.8 sigma
        angle[i] = static_cast<float>(two_pi) * (static_cast<float>(b.word[1][i] >> 8) * 0x1.0p-24f);
      }
      const Draws radius = (-2.f * u.log()).sqrt(), x = radius * angle.cos(), y = radius * angle.sin();
      float drawn[2 * wide];
      for (int i = 0; i < wide; ++i) drawn[2 * i] = x[i], drawn[2 * i + 1] = y[i];
      std::copy_n(drawn, std::min(2 * wide, cols - col), out + col);
    }
  });
}

void RandomStream::fill_uniform(cv::Mat& image) const {
  const int cols = image.cols;
  const std::uint64_t blocks = static_cast<std::uint64_t>(cols + 3) / 4;
  const std::uint64_t key = mix_keys(key_, 2);
  for_rows("fill_uniform", image, [&](float* out, std::uint64_t row) {
    float drawn[4 * wide];
    for (int col = 0; col < cols; col += 4 * wide) {
      const Blocks<wide> b = philox<wide>(key, row * blocks + static_cast<std::uint64_t>(col / 4));
      for (int i = 0; i < wide; ++i)
        for (int w = 0; w < 4; ++w) drawn[4 * i + w] = static_cast<float>(b.word[w][i] >> 8) * 0x1.0p-24f;
      std::copy_n(drawn, std::min(4 * wide, cols - col), out + col);
    }
  });
}

RandomStream frame_stream(std::uint64_t seed, std::uint64_t capture_key, std::int64_t frame,
                          std::string_view instance) {
  std::uint64_t key = mix_keys(seed, capture_key);
  key = mix_keys(key, static_cast<std::uint64_t>(frame));
  return RandomStream(mix_keys(key, hash_text(instance)));
}

RandomStream unit_stream(std::uint64_t unit_seed, std::string_view instance) {
  return RandomStream(mix_keys(mix_keys(unit_seed, 0x756e6974ull), hash_text(instance)));
}

}  // namespace binrig
