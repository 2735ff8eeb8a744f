// Checks a configuration against its list of fields.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "flockstep/fields.hpp"

namespace flockstep {

// Throw std::invalid_argument if the value is not allowed. The message uses `name` as the field's name.
void check_number(float value, const Limits& limits, const std::string& name);
void check_number(double value, const Limits& limits, const std::string& name);
void check_number(int value, const Limits& limits, const std::string& name);
void check_number(std::uint64_t value, const Limits& limits, const std::string& name);
void check_text(const std::string& text, Form form, const std::string& name);
void check_quaternion(const std::array<float, 4>& quat_wxyz, const std::string& name);
void check_direction(const std::array<float, 3>& direction, const std::string& name);

// Describes the allowed numbers in a message: "an integer in [1, 8192]", "a finite number > 0", "0 or a number in [0.1, 45]".
std::string expected_number(const Limits& limits, bool is_integer);

// Checks the value of one field. A nested configuration validates itself.
template <class Value>
void check_value(const Value& value, const FieldInfo& info, const std::string& name) {
  if constexpr (std::is_same_v<Value, std::string>) {
    check_text(value, info.form, name);
  } else if constexpr (requires { value.validate(); }) {
    value.validate();
  } else if constexpr (std::is_arithmetic_v<Value> && !std::is_same_v<Value, bool>) {
    check_number(value, info.limits, name);
  }
}
template <class Value>
void check_value(const std::optional<Value>& value, const FieldInfo& info, const std::string& name) {
  if (value) check_value(*value, info, name);
}
template <class Values>
void check_each(const Values& values, const FieldInfo& info, const std::string& name) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    const FieldInfo one = info.of_element(i);
    if constexpr (std::is_arithmetic_v<typename Values::value_type>) {
      if (one.limits.contain(values[i])) continue;  // a pattern has many beams: do not build a name for each
    }
    check_value(values[i], one, name + '[' + std::to_string(i) + ']');
  }
}
template <class Value>
void check_value(const std::vector<Value>& values, const FieldInfo& info, const std::string& name) {
  check_each(values, info, name);
}
template <class Value, std::size_t kSize>
void check_value(const std::array<Value, kSize>& values, const FieldInfo& info, const std::string& name) {
  if constexpr (std::is_same_v<Value, float> && kSize == 4) {
    if (info.form == Form::unit_quaternion) return check_quaternion(values, name);
  }
  check_each(values, info, name);
  if constexpr (std::is_same_v<Value, float> && kSize == 3) {
    if (info.form == Form::direction) check_direction(values, name);
  }
}

// The name of a field in messages. It is no template: every check of every field builds one.
std::string name_of(const std::string& prefix, const char* name, const FieldInfo& info);

// Throws std::invalid_argument that names the first field with an invalid value, the expected values and the actual one. The
// prefix precedes each field name, for example "lidar.". validate() checks the rules that compare fields with each other.
template <HasFields Config>
void check_fields(const Config& config, const std::string& prefix) {
  for_each_field(config, [&](const auto& field, const auto& value) {
    check_value(value, field.info, name_of(prefix, field.name, field.info));
  });
}

}  // namespace flockstep
