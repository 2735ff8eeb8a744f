#include "base/excerpt.hpp"

#include <gtest/gtest.h>

#include <string>

namespace flockstep {
namespace {

TEST(Excerpt, ShortTextsAreKept) {
  EXPECT_EQ(excerpt(""), "");
  EXPECT_EQ(excerpt("a wall"), "a wall");
  EXPECT_EQ(excerpt(std::string(60, 'x')), std::string(60, 'x'));
  EXPECT_EQ(excerpt("1\u00e9\u20ac\U0001F600"), "1\u00e9\u20ac\U0001F600");
}

TEST(Excerpt, LongTextsAreCutBetweenCharacters) {
  EXPECT_EQ(excerpt(std::string(61, 'x')), std::string(60, 'x') + "...");
  EXPECT_EQ(excerpt("abc\u20ac", 6), "abc\u20ac");
  EXPECT_EQ(excerpt("abc\u20ac", 5), "abc...");
  EXPECT_EQ(excerpt("\U0001F600\U0001F600", 7), "\U0001F600...");
}

TEST(Excerpt, InvalidUtf8IsShownAsQuestionMarks) {
  EXPECT_EQ(excerpt("a\nb\tc\x7F"), "a?b?c?");
  EXPECT_EQ(excerpt(std::string("a\0b", 3)), "a?b");
  EXPECT_EQ(excerpt("\xE9t\xE9"), "?t?");          // Latin-1
  EXPECT_EQ(excerpt("\xC0\xAF"), "??");            // overlong
  EXPECT_EQ(excerpt("\xE0\x80\xAF"), "???");       // overlong
  EXPECT_EQ(excerpt("\xED\xA0\x80"), "???");       // surrogate
  EXPECT_EQ(excerpt("\xF4\x90\x80\x80"), "????");  // beyond the last code point
  EXPECT_EQ(excerpt("ab\xE2\x82"), "ab??");        // truncated
}

}  // namespace
}  // namespace flockstep
