#include <gtest/gtest.h>

#include "core/error.h"
#include "core/uri.h"

namespace binrig {
namespace {

TEST(Error, EveryViolationIsALineOfItsText) {
  const Error error("two things are wrong", {{"m.yaml:3", "bow.amplitude", "5", "mm", "-2 .. 2", "is out of bounds"},
                                             {"m.yaml:4", "", "", "", "", "is no effect"}});
  EXPECT_STREQ(error.what(), "two things are wrong\n  m.yaml:3: bow.amplitude = 5 mm is out of bounds (accepted: -2 .. 2 mm)\n"
                             "  m.yaml:4: is no effect");
  EXPECT_EQ(error.violations().size(), 2u);
}

TEST(Error, TheNearestWordIsFoundAndNonsenseFindsNone) {
  const std::vector<std::string> words{"rate", "loop", "amplitude", "correlation_length"};
  EXPECT_EQ(nearest_word("raet", words), "rate");
  EXPECT_EQ(nearest_word("amplitud", words), "amplitude");
  EXPECT_EQ(nearest_word("corelation_lenght", words), "correlation_length");
  EXPECT_EQ(nearest_word("zebra", words), "");
}

TEST(Error, NumbersReadBackTheSame) {
  for (double value : {0.1, 1.0 / 3, 1e-300, -123456.789012345}) EXPECT_EQ(std::stod(number_text(value)), value);
}

TEST(Uri, PartsInEitherOrder) {
  for (const char* text : {"replay:/a/set#train/2?rate=max&loop=1", "replay:/a/set?rate=max&loop=1#train/2"}) {
    Uri uri = Uri::parse(text);
    EXPECT_EQ(uri.scheme, "replay");
    EXPECT_EQ(uri.path, "/a/set");
    EXPECT_EQ(uri.fragment, "train/2");
    EXPECT_EQ(uri.take("rate"), "max");
    EXPECT_EQ(uri.take("rate"), std::nullopt);
    EXPECT_THROW(uri.finish({"rate", "loop"}), Error);
    uri.take("loop");
    EXPECT_NO_THROW(uri.finish({"rate", "loop"}));
  }
  EXPECT_THROW(Uri::parse("/a/set"), Error);
  EXPECT_THROW(Uri::parse("replay:/a/set?rate"), Error);
}

}  // namespace
}  // namespace binrig
