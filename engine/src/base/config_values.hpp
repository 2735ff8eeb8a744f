// Converts values of configurations to JSON and back, based on their lists of fields; see recipe/config_json.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <vector>

#include "base/check_fields.hpp"
#include "base/field_offsets.hpp"
#include "base/world_field.hpp"
#include "flockstep/fields.hpp"

namespace flockstep::config_values {

using Json = nlohmann::json;
using OrderedJson = nlohmann::ordered_json;

std::string member(const std::string& path, const std::string& key);
std::string element(const std::string& path, std::size_t index);

// Writes and reads values of one type.
struct ValueType {
  OrderedJson (*write)(const void* value, const std::string& path);
  void (*read)(const Json& json, const FieldInfo& info, const std::string& path, void* value);
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

// Returns true for a struct of bools.
template <class Config>
consteval bool are_all_bools() {
  return std::apply([]<class... Values>(const FieldPointer<Config, Values>&...) { return (std::is_same_v<Values, bool> && ...); },
                    kFields<Config>);
}

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
  if constexpr (are_all_bools<Config>()) return written_flags(members_of<Config>(), &config);
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

void read_value(const Json& json, const FieldInfo&, const std::string& path, bool& value);
inline void read_value(const Json& json, const FieldInfo&, const std::string& path, WorldField& world) {
  world = read_world_field(json, path);
}
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::string& value);
void read_flags(const Json& json, const std::string& path, const Members& members, void* flags);
std::size_t read_name(const Json& json, const std::string& path, std::span<const char* const> names);
void read_object(const Json& json, const std::string& path, const Members& members, void* config);
void require_array(const Json& json, const std::string& path);
void require_array_of(std::size_t size, const Json& json, const std::string& path);
void read_value(const Json& json, const FieldInfo& info, const std::string& path, int& value);
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::uint64_t& value);
void read_value(const Json& json, const FieldInfo& info, const std::string& path, float& value);
void read_value(const Json& json, const FieldInfo& info, const std::string& path, double& value);
template <class Value>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::vector<Value>& values);
template <class Value, std::size_t kSize>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::array<Value, kSize>& values);

template <class Enum>
  requires std::is_enum_v<Enum>
void read_value(const Json& json, const FieldInfo&, const std::string& path, Enum& value) {
  value = static_cast<Enum>(read_name(json, path, EnumNames<Enum>::kNames));
}
template <HasFields Config>
void read_value(const Json& json, const FieldInfo&, const std::string& path, Config& config) {
  if constexpr (are_all_bools<Config>()) {
    read_flags(json, path, members_of<Config>(), &config);
  } else {
    read_object(json, path, members_of<Config>(), &config);
  }
}
template <class Value>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::optional<Value>& value) {
  if (json.is_null()) {
    value.reset();
  } else {
    read_value(json, info, path, value.emplace());
  }
}
template <class Value>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::vector<Value>& values) {
  require_array(json, path);
  values = std::vector<Value>(json.size());
  for (std::size_t i = 0; i < values.size(); ++i) read_value(json[i], info, element(path, i), values[i]);
}
template <class Value, std::size_t kSize>
void read_value(const Json& json, const FieldInfo& info, const std::string& path, std::array<Value, kSize>& values) {
  require_array_of(kSize, json, path);
  for (std::size_t i = 0; i < kSize; ++i) read_value(json[i], info.of_element(i), element(path, i), values[i]);
  check_value(values, info, path);
}

template <class Value>
constexpr ValueType kValueType{
    [](const void* value, const std::string& path) { return written(*static_cast<const Value*>(value), path); },
    [](const Json& json, const FieldInfo& info, const std::string& path, void* value) {
      read_value(json, info, path, *static_cast<Value*>(value));
    }};

template <class Config>
const Members& members_of() {
  static const Members members = list_fields<Member, Config>(
      []<class Value>(const char* name, const FieldInfo* info, std::ptrdiff_t offset, std::type_identity<Value>) {
        return Member{name, info, offset, &kValueType<Value>};
      });
  return members;
}

}  // namespace flockstep::config_values
