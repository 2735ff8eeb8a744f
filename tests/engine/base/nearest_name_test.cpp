#include "base/nearest_name.hpp"

#include <gtest/gtest.h>

#include <array>
#include <string>
#include <string_view>
#include <vector>

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

}  // namespace
}  // namespace flockstep
