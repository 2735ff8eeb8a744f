// Headers for nearly every test: GoogleTest, headers of the standard library (precompiled), looks at refusals, folders
// and constants. Tests look at what a refusal names, not at its words, which base/check_fields_test.cpp alone checks.
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

namespace flockstep::testing {

// Returns the message of the error that the call throws, or "accepted".
template <class Error = std::invalid_argument, class Call>
std::string refusal(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "accepted";
}

template <class Call>
std::string message_of(const Call& call) {
  return refusal<std::exception>(call);
}

// Returns whether a message has the parts of a pattern, in their order: the field or place, and the values. " ... " is between
// them.
inline ::testing::AssertionResult names(const std::string& message, std::string_view pattern) {
  constexpr std::string_view kGap = " ... ";
  for (std::size_t at = 0, part = 0; part != std::string_view::npos;) {
    const std::size_t end = pattern.find(kGap, part);
    const std::string_view wanted = pattern.substr(part, end == std::string_view::npos ? end : end - part);
    at = message.find(wanted, at);
    if (at == std::string::npos) return ::testing::AssertionFailure() << "expected " << wanted << " in: " << message;
    at += wanted.size();
    part = end == std::string_view::npos ? end : end + kGap.size();
  }
  return ::testing::AssertionSuccess();
}

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

// Expects the statement to throw std::invalid_argument with a message that names the parts of the pattern.
#define EXPECT_REFUSED(statement, pattern) \
  EXPECT_TRUE(flockstep::testing::names(flockstep::testing::refusal([&] { statement; }), pattern))
