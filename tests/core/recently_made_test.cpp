#include "core/recently_made.h"

#include <gtest/gtest.h>

#include <string>

#include "core/error.h"
#include "core/parallel.h"

namespace binrig {
namespace {

struct Counted {
  int made = 0;
  template <typename Cache>
  int of(Cache& cache, int key) {
    return cache.get(key, [&] { return ++made, 10 * key; });
  }
};

TEST(RecentlyMade, IsMadeOnceWhileItIsKept) {
  RecentlyMade<int, int> cache(2);
  Counted count;
  EXPECT_EQ(count.of(cache, 1), 10);
  EXPECT_EQ(count.of(cache, 2), 20);
  EXPECT_EQ(count.of(cache, 1), 10);
  EXPECT_EQ(count.made, 2);
}

TEST(RecentlyMade, WhatWasUsedLongestAgoGoesFirst) {
  RecentlyMade<int, int> cache(2);
  Counted count;
  count.of(cache, 1), count.of(cache, 2), count.of(cache, 1), count.of(cache, 3);
  EXPECT_EQ(count.made, 3);
  count.of(cache, 1);
  EXPECT_EQ(count.made, 3);
  count.of(cache, 2);
  EXPECT_EQ(count.made, 4);
}

TEST(RecentlyMade, SizesAreWhatTheLimitCounts) {
  RecentlyMade<int, int> cache(70, [](int value) { return static_cast<std::size_t>(value); });
  Counted count;
  count.of(cache, 1), count.of(cache, 2), count.of(cache, 4);  // 10 + 20 + 40
  count.of(cache, 1);
  EXPECT_EQ(count.made, 3);
  count.of(cache, 3);  // 2 and 4 go
  count.of(cache, 1), count.of(cache, 3);
  EXPECT_EQ(count.made, 4);
  count.of(cache, 9);  // alone larger than the limit
  count.of(cache, 9);
  EXPECT_EQ(count.made, 5);
  count.of(cache, 3);
  EXPECT_EQ(count.made, 6);
}

TEST(RecentlyMade, WhatCannotBeMadeIsTriedAgain) {
  RecentlyMade<int, int> cache(2);
  EXPECT_THROW(cache.get(1, []() -> int { throw Error("not yet"); }), Error);
  EXPECT_EQ(cache.get(1, [] { return 5; }), 5);
}

TEST(RecentlyMade, ThreadsGetTheirKeysValues) {
  RecentlyMade<int, std::string> cache(3);
  parallel_for(1000, [&](int i) {
    const int key = i % 7;
    EXPECT_EQ(cache.get(key, [&] { return std::to_string(key); }), std::to_string(key));
  });
}

}  // namespace
}  // namespace binrig
