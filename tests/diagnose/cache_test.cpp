// What the cache of simulated statistics gives back, and how much room it takes.
#include "diagnose/cache.h"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include <gtest/gtest.h>

#include "core/random.h"
#include "tests/support/recordings.h"

namespace binrig {
namespace {

constexpr float unknown = std::numeric_limits<float>::quiet_NaN();

bool same(const std::vector<float>& a, const std::vector<float>& b) {
  bool result = a.size() == b.size();
  for (std::size_t i = 0; result && i < a.size(); ++i) result = a[i] == b[i] || (std::isnan(a[i]) && std::isnan(b[i]));
  return result;
}

std::uintmax_t room(const std::filesystem::path& folder) {
  std::uintmax_t bytes = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    if (entry.is_regular_file()) bytes += entry.file_size();
  return bytes;
}

TEST(SimulationCache, GivesBackWhatWasPutInWhereverItIsUnknown) {
  const test::ScratchFolder folder;
  const SimulationCache cache(folder.path());
  const RandomStream random(5);
  std::uint64_t draw = 0;
  std::uint64_t key = 1;
  for (const std::size_t size : {0, 1, 2, 7, 1000})
    for (const double known : {0.0, 0.1, 0.5, 0.9, 1.0}) {
      std::vector<float> values(size);
      for (float& value : values)
        value = random.uniform(draw++) < known ? static_cast<float>(random.uniform(draw++)) - 0.5f : unknown;
      EXPECT_FALSE(cache.get(key));
      cache.put(key, values);
      const auto kept = cache.get(key++);
      ASSERT_TRUE(kept);
      EXPECT_TRUE(same(*kept, values)) << size << " values, " << known << " known";
    }
}

TEST(SimulationCache, WhatIsUnknownTakesNoRoom) {
  const test::ScratchFolder folder;
  std::vector<float> values(100000, unknown);
  std::fill_n(values.begin() + 40000, 1000, 1.5f);
  SimulationCache(folder.path()).put(1, values);
  EXPECT_LT(room(folder.path()), 1000 * sizeof(float) + 64);
}

TEST(SimulationCache, AFileThatWasCutShortIsNone) {
  const test::ScratchFolder folder;
  const SimulationCache cache(folder.path());
  cache.put(1, {unknown, 1, 2, unknown, 3});
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder.path()))
    if (entry.is_regular_file())
      for (auto size = entry.file_size(); size-- > 0;) {
        std::filesystem::resize_file(entry.path(), size);
        EXPECT_FALSE(cache.get(1)) << size << " bytes";
      }
}

}  // namespace
}  // namespace binrig
