// Replays the inputs that the fuzzers found, tests/fuzz/corpus/TARGET/*. `./dev fuzz TARGET` searches for more.

#include <iterator>

#include "fuzz/targets.hpp"
#include "standard.hpp"

namespace flockstep::fuzz {
namespace {

class Corpus : public ::testing::TestWithParam<Target> {};

TEST_P(Corpus, RunsThrough) {
  std::size_t count = 0;
  GetParam().run({});
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(FLOCKSTEP_CORPUS) / GetParam().name)) {
    SCOPED_TRACE(entry.path());
    std::ifstream file(entry.path(), std::ios::binary);
    const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    GetParam().run(bytes);
    ++count;
  }
  EXPECT_GT(count, 0U);
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Corpus, ::testing::ValuesIn(targets()), [](const auto& test) { return test.param.name; });

}  // namespace
}  // namespace flockstep::fuzz
