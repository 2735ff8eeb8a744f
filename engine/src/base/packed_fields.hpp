// Packs configurations into bytes by their field lists, and reads them back.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/require.hpp"
#include "base/world_field.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Numbers and enumerations, strings, arrays, lists, optionals, and structs that list such fields. Bools are numbers.
class FieldPacker {
 public:
  template <class T>
  void add(const T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
    } else if constexpr (HasFields<T>) {
      for_each_field(value, [this](const auto&, const auto& part) { this->add(part); });
    } else {
      add_parts(value);
    }
  }
  const std::string& bytes() const { return bytes_; }

 private:
  void add_parts(const WorldField& world) { add_parts(bytes_of_field(world)); }
  template <class T, std::size_t kSize>
  void add_parts(const std::array<T, kSize>& values) {
    for (const T& value : values) add(value);
  }
  template <class T>
  void add_parts(const std::optional<T>& value) {
    add(static_cast<std::uint8_t>(value.has_value()));
    if (value) add(*value);
  }
  template <class List>  // a vector or a string
  void add_parts(const List& values) {
    add(static_cast<std::uint64_t>(values.size()));
    for (const auto& value : values) add(value);
  }

  std::string bytes_;
};

// Throws std::invalid_argument, naming `name`, if the bytes end early or an enumeration has no such member.
class FieldUnpacker {
 public:
  FieldUnpacker(std::string_view bytes, const char* name) : left_(bytes), name_(name) {}

  bool at_end() const { return left_.empty(); }
  std::size_t size() const { return left_.size(); }

  template <class T>
  void take(T& value) {
    if constexpr (std::is_same_v<T, bool>) {
      std::uint8_t flag = 0;
      take(flag);
      require(flag <= 1, name_, "flags of 0 or 1", +flag);
      value = flag == 1;
    } else if constexpr (std::is_enum_v<T>) {
      std::underlying_type_t<T> number{};
      take(number);
      require(static_cast<std::size_t>(number) < EnumNames<T>::kNames.size(), name_, "members of an enumeration", +number);
      value = static_cast<T>(number);
    } else if constexpr (std::is_arithmetic_v<T>) {
      require(left_.size() >= sizeof(T), name_, "complete bytes", "bytes that end early");
      std::memcpy(&value, left_.data(), sizeof(T));
      left_.remove_prefix(sizeof(T));
    } else if constexpr (HasFields<T>) {
      for_each_field(value, [this](const auto&, auto& part) { this->take(part); });
    } else {
      take_parts(value);
    }
  }

 private:
  void take_parts(WorldField& world) {
    std::string bytes;
    take_parts(bytes);
    world = world_of_field(bytes);
  }
  template <class T, std::size_t kSize>
  void take_parts(std::array<T, kSize>& values) {
    for (T& value : values) take(value);
  }
  template <class T>
  void take_parts(std::optional<T>& value) {
    bool has = false;
    take(has);
    value.reset();
    if (has) take(value.emplace());
  }
  template <class List>
  void take_parts(List& values) {
    std::uint64_t count = 0;
    take(count);
    require(count <= left_.size(), name_, "complete bytes", "bytes that end early");  // each value takes at least a byte
    values.clear();
    for (std::uint64_t i = 0; i < count; ++i) {
      typename List::value_type value{};
      take(value);
      values.push_back(std::move(value));
    }
  }

  std::string_view left_;
  const char* name_;
};

}  // namespace flockstep
