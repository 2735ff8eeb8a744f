// Converts values of configurations to JSON and back, based on their lists of fields; see recipe/config_json.hpp. Scene files are
// read by the same functions; see formats/scene_values.hpp. Include it in files that instantiate the templates.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/check_fields.hpp"
#include "base/field_offsets.hpp"
#include "base/interrupt.hpp"
#include "base/json_document.hpp"
#include "base/world_field.hpp"
#include "flockstep/fields.hpp"

namespace flockstep::config_values {

using json::JsonField;
using OrderedJson = nlohmann::ordered_json;

std::string member(const std::string& path, const std::string& key);
std::string element(const std::string& path, std::size_t index);

// Writes and reads values of one type.
struct ValueType {
  OrderedJson (*write)(const void* value, const std::string& path);
  void (*read)(const JsonField& field, const FieldInfo& info, void* value);
};

// A field of a configuration. Only type-dependent code is a template, because each instance costs compile time.
struct Member {
  std::string_view name;
  const FieldInfo* info;
  std::ptrdiff_t offset;
  const ValueType* type;
};
using Members = std::vector<Member>;

template <class Config>
const Members& members_of();

// -- Writing

inline OrderedJson written(bool value, const std::string&) { return value; }
inline OrderedJson written(int value, const std::string&) { return value; }
inline OrderedJson written(std::uint64_t value, const std::string&) { return value; }
inline OrderedJson written(const std::string& value, const std::string&) { return value; }
inline OrderedJson written(const WorldField& world, const std::string&) { return json_of_field(world); }
OrderedJson written(float value, const std::string& path);
OrderedJson written(double value, const std::string& path);
OrderedJson written_object(const Members& members, const void* config, const std::string& path);
OrderedJson written_flags(const Members& members, const void* flags);

template <class Value>
OrderedJson written(const std::optional<Value>& value, const std::string& path);
template <class Values>
  requires requires(Values values) {
    values.size();
    values[0];
  }
OrderedJson written(const Values& values, const std::string& path);

template <class Enum>
  requires std::is_enum_v<Enum>
OrderedJson written(Enum value, const std::string&) {
  return EnumNames<Enum>::kNames.at(static_cast<std::size_t>(value));
}
template <HasFields Config>
OrderedJson written(const Config& config, const std::string& path) {
  if constexpr (SetOfNames<Config>) return written_flags(members_of<Config>(), &config);
  return written_object(members_of<Config>(), &config, path);
}
template <class Value>
OrderedJson written(const std::optional<Value>& value, const std::string& path) {
  return value ? written(*value, path) : OrderedJson();
}
template <class Values>
  requires requires(Values values) {
    values.size();
    values[0];
  }
OrderedJson written(const Values& values, const std::string& path) {
  OrderedJson list = OrderedJson::array();
  for (std::size_t i = 0; i < values.size(); ++i) list.push_back(written(values[i], element(path, i)));
  return list;
}

// -- Reading

void read_value(const JsonField& field, const FieldInfo& info, bool& value);
void read_value(const JsonField& field, const FieldInfo& info, std::string& value);
void read_value(const JsonField& field, const FieldInfo& info, int& value);
void read_value(const JsonField& field, const FieldInfo& info, std::uint64_t& value);
void read_value(const JsonField& field, const FieldInfo& info, float& value);
void read_value(const JsonField& field, const FieldInfo& info, double& value);
inline void read_value(const JsonField& field, const FieldInfo&, WorldField& world) {
  world = read_world_field(field.value, name_of(field));
}
template <class Value>
void read_value(const JsonField& field, const FieldInfo& info, std::vector<Value>& values);
template <class Value, std::size_t kSize>
void read_value(const JsonField& field, const FieldInfo& info, std::array<Value, kSize>& values);

void read_flags(const JsonField& field, const Members& members, void* flags);
void read_object(const JsonField& field, const Members& members, void* config);
std::size_t size_of_list(const JsonField& field);
void require_array_of(std::size_t size, const JsonField& field);
// Returns the position of a name in a list of them.
std::size_t read_name(const JsonField& field, std::span<const char* const> names);
template <class Enum>
Enum read_choice(const JsonField& field) {
  return static_cast<Enum>(read_name(field, EnumNames<Enum>::kNames));
}

template <class Enum>
  requires std::is_enum_v<Enum>
void read_value(const JsonField& field, const FieldInfo&, Enum& value) {
  value = read_choice<Enum>(field);
}
template <HasFields Config>
void read_value(const JsonField& field, const FieldInfo&, Config& config) {
  if constexpr (SetOfNames<Config>) {
    read_flags(field, members_of<Config>(), &config);
  } else {
    read_object(field, members_of<Config>(), &config);
  }
}
template <class Value>
void read_value(const JsonField& field, const FieldInfo& info, std::optional<Value>& value) {
  value.reset();
  if (!field.is_config || !field.value.is_null()) read_value(field, info, value.emplace());
}
template <class Value>
void read_value(const JsonField& field, const FieldInfo& info, std::vector<Value>& values) {
  values = std::vector<Value>(size_of_list(field));
  for (std::size_t i = 0; i < values.size(); ++i) {
    Interrupt::poll();
    read_value(child(field, i), info, values[i]);
  }
}
template <class Value, std::size_t kSize>
void read_value(const JsonField& field, const FieldInfo& info, std::array<Value, kSize>& values) {
  require_array_of(kSize, field);
  for (std::size_t i = 0; i < kSize; ++i) read_value(child(field, i), info.of_element(i), values[i]);
  if (info.form == Form::direction && !field.is_config) {  // in double precision: float32 rounds small numbers to 0
    const bool is_zero = std::ranges::all_of(field.value, [](const auto& number) { return number == 0; });
    if (is_zero) refuse(field, "a direction that is not 0");
    return;
  }
  if (info.form != Form::any) check_value(values, info, name_of(field));
}

template <class Value>
constexpr ValueType kValueType{
    [](const void* value, const std::string& path) { return written(*static_cast<const Value*>(value), path); },
    [](const JsonField& field, const FieldInfo& info, void* value) { read_value(field, info, *static_cast<Value*>(value)); }};

template <class Config>
const Members& members_of() {
  static const Members members = list_fields<Member, Config>(
      []<class Value>(const char* name, const FieldInfo* info, std::ptrdiff_t offset, std::type_identity<Value>) {
        return Member{name, info, offset, &kValueType<Value>};
      });
  return members;
}

}  // namespace flockstep::config_values
