#include "base/check_fields.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "base/require.hpp"

namespace flockstep {
namespace {

template <class Number>
void check(Number value, const Limits& limits, const std::string& name) {
  if (!limits.contain(value)) refuse(name, expected_number(limits, std::is_integral_v<Number>), value);
}

}  // namespace

std::string Limits::text() const {
  std::ostringstream text;
  text.precision(10);
  const bool has_least = std::isfinite(least), has_greatest = std::isfinite(greatest);
  if (num_choices > 0) {
    for (std::size_t i = 0; i < num_choices; ++i) text << (i == 0 ? "" : i + 1 == num_choices ? " or " : ", ") << choices[i];
  } else if (has_least && least == -greatest && !excludes_least && !excludes_greatest) {
    text.precision(6);
    text << "within +-" << greatest;
  } else if (has_least && has_greatest) {
    text << "in " << (excludes_least ? '(' : '[') << least << ", " << greatest << (excludes_greatest ? ')' : ']');
  } else if (has_least) {
    text << (excludes_least ? "> " : ">= ") << least;
  } else if (has_greatest) {
    text << (excludes_greatest ? "< " : "<= ") << greatest;
  }
  return text.str();
}

std::string expected_number(const Limits& limits, bool is_integer) {
  const std::string text = limits.text();
  if (limits.num_choices > 0) return text;
  const std::string noun = is_integer ? "an integer" : limits.are_bounded() ? "a number" : "a finite number";
  const std::string kind = (limits.or_zero ? "0 or " : "") + noun;
  return text.empty() ? kind : kind + ' ' + text;
}

void check_number(float value, const Limits& limits, const std::string& name) { check(value, limits, name); }
void check_number(double value, const Limits& limits, const std::string& name) { check(value, limits, name); }
void check_number(int value, const Limits& limits, const std::string& name) { check(value, limits, name); }
void check_number(std::uint64_t value, const Limits& limits, const std::string& name) { check(value, limits, name); }

void check_text(const std::string& text, Form form, const std::string& name) {
  const auto is_plain = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' || c == '-';
  };
  if (form != Form::plain_name || (!text.empty() && std::all_of(text.begin(), text.end(), is_plain))) return;
  refuse(name, "letters, digits, _ and -", '"' + text + '"');
}

void check_quaternion(const std::array<float, 4>& quat_wxyz, const std::string& name) {
  float norm = 0.0F;
  for (const float value : quat_wxyz) norm += value * value;
  norm = std::sqrt(norm);
  require(std::abs(norm - 1.0F) < 1e-2F, name, "a unit quaternion (w, x, y, z)", "one of norm " + std::to_string(norm));
}

void check_direction(const std::array<float, 3>& direction, const std::string& name) {
  require(direction != std::array<float, 3>{}, name, "a direction that is not 0", "(0, 0, 0)");
}

std::string name_of(const std::string& prefix, const char* name, const FieldInfo& info) {
  return prefix + (info.alias == nullptr ? name : info.alias);
}

}  // namespace flockstep
