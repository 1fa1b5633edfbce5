// What is kept of rendered pictures, and what goes first.
#include "sim/channel_cache.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

namespace binrig {
namespace {

constexpr auto depth = static_cast<ChannelSet>(Channel::depth);
constexpr auto normal = static_cast<ChannelSet>(Channel::normal);

std::shared_ptr<const Channels> picture(float depth_mm) {
  auto channels = std::make_shared<Channels>();
  channels->depth_mm = cv::Mat(8, 8, CV_32F, cv::Scalar(depth_mm));
  return channels;
}
constexpr std::size_t bytes = 8 * 8 * sizeof(float);

TEST(ChannelCache, FindsAPictureThatHasAtLeastTheWantedChannels) {
  ChannelCache cache(100 * bytes);
  const auto both = picture(1);
  cache.add("a", depth | normal, both);
  EXPECT_EQ(cache.find("a", depth), both);
  EXPECT_EQ(cache.find("a", depth | normal), both);
  EXPECT_EQ(cache.find("b", depth), nullptr);
  cache.add("b", depth, picture(2));
  EXPECT_EQ(cache.find("b", depth | normal), nullptr);
}

TEST(ChannelCache, OneWithMoreChannelsTakesThePlaceOfOneWithFewer) {
  ChannelCache cache(2 * bytes);
  cache.add("other", depth, picture(1));
  cache.add("a", depth, picture(2));
  const auto more = picture(3);
  cache.add("a", depth | normal, more);
  EXPECT_EQ(cache.find("a", depth), more);
  EXPECT_NE(cache.find("other", depth), nullptr) << "there was room for two";
}

TEST(ChannelCache, TheLeastRecentlyUsedGoesFirst) {
  ChannelCache cache(2 * bytes);
  cache.add("a", depth, picture(1));
  cache.add("b", depth, picture(2));
  EXPECT_NE(cache.find("a", depth), nullptr);
  cache.add("c", depth, picture(3));
  EXPECT_EQ(cache.find("b", depth), nullptr);
  EXPECT_NE(cache.find("a", depth), nullptr);
  EXPECT_NE(cache.find("c", depth), nullptr);
}

TEST(ChannelCache, OneThatIsLargerThanTheLimitIsKeptUntilTheNext) {
  ChannelCache cache(bytes / 2);
  cache.add("a", depth, picture(1));
  EXPECT_NE(cache.find("a", depth), nullptr);
  cache.add("b", depth, picture(2));
  EXPECT_EQ(cache.find("a", depth), nullptr);
}

}  // namespace
}  // namespace binrig
