#include "base/excerpt.hpp"
#include "base/hash.hpp"
#include "base/nearest_name.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

constexpr std::array<std::string_view, 5> kNames{"autoreset_mode", "max_episode_steps", "frame_skip", "stagger_first_episode",
                                                 "random_world"};

TEST(NearestName, IsTheIntendedName) {
  EXPECT_EQ(nearest_name("frame_skp", kNames), "frame_skip");
  EXPECT_EQ(nearest_name("max_episode_step", kNames), "max_episode_steps");
  EXPECT_EQ(nearest_name("world", kNames), "");
  EXPECT_EQ(nearest_name("random_worlds", kNames), "random_world");
  EXPECT_EQ(nearest_name("", kNames), "");
  EXPECT_EQ(nearest_name("frame_skip", {}), "");
  EXPECT_EQ(did_you_mean("frame_skp", kNames), ". Did you mean frame_skip?");
  EXPECT_EQ(did_you_mean("speed", kNames), "");
}

// Values from Python: difflib.SequenceMatcher(None, a, b).ratio().
TEST(NearestName, SimilaritiesAreThoseOfDifflib) {
  EXPECT_EQ(name_similarity("frame_skip", "frame_skp"), 18.0 / 19.0);
  EXPECT_EQ(name_similarity("abcd", "bcde"), 0.75);
  EXPECT_EQ(name_similarity("tide", "diet"), 0.25);
  EXPECT_EQ(name_similarity("diet", "tide"), 0.5);
  EXPECT_EQ(name_similarity("private", "privative thrust"), 14.0 / 23.0);
  EXPECT_EQ(name_similarity("", ""), 1.0);
  EXPECT_EQ(name_similarity("a", ""), 0.0);
}

TEST(NearestName, OfEquallySimilarOnesIsTheLastByTheAlphabet) {
  constexpr std::array<std::string_view, 3> kPair{"beam_a", "beam_c", "beam_b"};
  EXPECT_EQ(nearest_name("beam_x", kPair), "beam_c");
}

TEST(NearestName, OfPathsIsSimilarInTheLastPart) {
  constexpr std::array<std::string_view, 4> kPaths{"arena/hall", "indoor/warehouse", "outdoor/city", "race/warehouse"};
  EXPECT_EQ(nearest_name("hall", kPaths), "arena/hall");
  EXPECT_EQ(nearest_names("warehouse", kPaths, 3), (std::vector<std::string_view>{"indoor/warehouse", "race/warehouse"}));
  EXPECT_EQ(nearest_names("warehouse", kPaths, 1), (std::vector<std::string_view>{"indoor/warehouse"}));
  EXPECT_TRUE(nearest_names("forest", kPaths, 3).empty());
}

TEST(NearestName, MayBeGivenByItsInitials) {
  constexpr std::array<std::string_view, 2> kWords{"learning_rate", "clip_range"};
  EXPECT_EQ(nearest_name("lr", kWords), "learning_rate");
  EXPECT_EQ(nearest_name("l", kWords), "");
  EXPECT_EQ(nearest_name("lrs", kWords), "");
}

TEST(NearestName, LongNamesAreNotCompared) { EXPECT_EQ(nearest_name(std::string(1'000'000, 'a'), kNames), ""); }

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

constexpr std::string_view kText =
    "The quick brown fox jumps over the lazy dog, then walks home. The quick brown fox jumps over the lazy dog, then walks home.";

std::uint64_t hash_of(std::string_view text, std::uint64_t seed = 0) { return xxh64(std::as_bytes(std::span(text)), seed); }

// Values of the reference implementation, for every kind of remainder length.
TEST(Hash, IsXxh64) {
  EXPECT_EQ(hash_of(""), 0xEF46DB3751D8E999U);
  EXPECT_EQ(hash_of(kText.substr(0, 1)), 0x5B4D6AF247A3CF7BU);
  EXPECT_EQ(hash_of(kText.substr(0, 3)), 0x4108F90B5DE14D15U);
  EXPECT_EQ(hash_of(kText.substr(0, 4)), 0xCDF13A49D263200FU);
  EXPECT_EQ(hash_of(kText.substr(0, 7)), 0xC6FCE9D72E310949U);
  EXPECT_EQ(hash_of(kText.substr(0, 8)), 0xD07B38A78A153B0BU);
  EXPECT_EQ(hash_of(kText.substr(0, 13)), 0xED6DC8C5841A51E4U);
  EXPECT_EQ(hash_of(kText.substr(0, 31)), 0x3F8D95AB32C127D9U);
  EXPECT_EQ(hash_of(kText.substr(0, 32)), 0xE2BBC9136629A4EEU);
  EXPECT_EQ(hash_of(kText.substr(0, 39)), 0xE01509EC7BDD4B5EU);
  EXPECT_EQ(hash_of(kText.substr(0, 63)), 0x7479E34CE37C6655U);
  EXPECT_EQ(hash_of(kText.substr(0, 64)), 0x442CBEF2243D523CU);
  EXPECT_EQ(hash_of(kText.substr(0, 101)), 0xAE6FAA2D97133BDDU);
  EXPECT_EQ(hash_of(kText.substr(0, 101), 0x123456789ABCDEFU), 0x1286202AB641889FU);
  EXPECT_EQ(hash_of(kText.substr(0, 5), 0x1U), 0x1A8CBEA48D66615DU);
  EXPECT_EQ(hash_of(kText.substr(0, 40), 0xFFFFFFFFFFFFFFFFU), 0xEA51B73D841655C6U);
}

TEST(Hash, BordersBetweenValuesCount) {
  Hash one, other;
  one.add(std::string_view("ab"));
  one.add(std::string_view("c"));
  other.add(std::string_view("a"));
  other.add(std::string_view("bc"));
  EXPECT_NE(one.value(), other.value());
  Hash with_nothing = one;
  with_nothing.add(std::string_view());
  EXPECT_NE(with_nothing.value(), one.value());
}

TEST(Hash, EveryByteCounts) {
  std::string text(100, 'x');
  for (std::size_t length = 1; length <= text.size(); ++length) {
    const std::uint64_t whole = hash_of(std::string_view(text).substr(0, length));
    for (std::size_t i = 0; i < length; ++i) {
      std::string changed = text.substr(0, length);
      changed[i] = 'y';
      ASSERT_NE(hash_of(changed), whole) << i << " of " << length;
    }
  }
}

}  // namespace
}  // namespace flockstep
