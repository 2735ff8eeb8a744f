// Headers for nearly every test: GoogleTest, headers of the standard library (precompiled), looks at refusals, folders
// and constants.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <memory>
#include <mutex>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "refusal.hpp"

namespace flockstep::testing {

// An empty folder for files of the current test.
class TempFolder : public std::filesystem::path {
 public:
  TempFolder() : path(path(::testing::TempDir()) / ("flockstep_" + name())) {
    std::filesystem::remove_all(*this);
    std::filesystem::create_directories(*this);
  }
  ~TempFolder() { std::filesystem::remove_all(*this); }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

 private:
  static std::string name() {
    const auto* const test = ::testing::UnitTest::GetInstance()->current_test_info();
    return std::string(test->test_suite_name()) + '_' + test->name();
  }
};

inline constexpr float kInfinity = std::numeric_limits<float>::infinity();  // range of a ray that hits nothing
inline constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

}  // namespace flockstep::testing
