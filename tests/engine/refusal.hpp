// How tests look at refusals: by what a message names, not by its words. Words are checked in base/check_fields_test.cpp alone.
#pragma once

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>
#include <string_view>

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

}  // namespace flockstep::testing

// Expects the statement to throw std::invalid_argument with a message that names the parts of the pattern.
#define EXPECT_REFUSED(statement, pattern) \
  EXPECT_TRUE(flockstep::testing::names(flockstep::testing::refusal([&] { statement; }), pattern))
