// What nearly every test needs: GoogleTest, headers of the standard library (precompiled), looks at refusals, folders
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

// An empty folder for files of a test.
class TempFolder : public std::filesystem::path {
 public:
  explicit TempFolder(const char* name) : path(path(::testing::TempDir()) / name) {
    std::filesystem::remove_all(*this);
    std::filesystem::create_directories(*this);
  }
  ~TempFolder() { std::filesystem::remove_all(*this); }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;
};

inline constexpr float kInfinity = std::numeric_limits<float>::infinity();  // range of a ray that hits nothing

}  // namespace flockstep::testing
