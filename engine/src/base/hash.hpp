// Hash: 64 bits of whatever it is fed, for telling configurations apart and finding damaged bytes.
// Source: FNV-1a, 64 bit (Fowler, Noll, Vo). Each byte goes through a bijection, so one changed byte always changes the result.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "flockstep/fields.hpp"

namespace flockstep {

class Hash {
 public:
  std::uint64_t value() const { return value_; }

  void bytes(const void* data, std::size_t count) {
    const auto* const first = static_cast<const unsigned char*>(data);
    for (std::size_t i = 0; i < count; ++i) value_ = (value_ ^ first[i]) * 0x100000001b3ULL;
  }

  // Everything that decides what a step does; of structs, field by field.
  template <class T>
  void add(const T& value) {
    if constexpr (HasFields<T>) {
      for_each_field(value, [this](const auto& field, const auto& part) {
        if (field.decides == Decides::nothing) return;
        add(std::string_view(field.name));
        add(part);
      });
    } else if constexpr (std::is_same_v<T, std::string> || std::is_same_v<T, std::string_view>) {
      add(value.size());
      bytes(value.data(), value.size());
    } else if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      bytes(&value, sizeof(value));
    } else {
      add_all(value);
    }
  }

 private:
  template <class T>
  void add_all(const std::optional<T>& value) {
    add(value.has_value());
    if (value) add(*value);
  }
  template <class T>
  void add_all(const std::vector<T>& values) {
    add(values.size());
    for (const T& value : values) add(value);
  }
  template <class T, std::size_t kSize>
  void add_all(const std::array<T, kSize>& values) {
    for (const T& value : values) add(value);
  }

  std::uint64_t value_ = 0xcbf29ce484222325ULL;
};

}  // namespace flockstep
