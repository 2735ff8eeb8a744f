// Hash: a 64-bit hash that identifies worlds and configurations and detects corrupt bytes. It uses XXH64, which reads eight
// bytes at a time in four independent lanes.
// Source: Y. Collet, "xxHash fast digest algorithm", specification 0.2.0, https://github.com/Cyan4973/xxHash/blob/dev/doc.
#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/world_field.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

static_assert(std::endian::native == std::endian::little);  // XXH64 is defined on little-endian words

inline std::uint64_t xxh64(std::span<const std::byte> bytes, std::uint64_t seed) {
  constexpr std::uint64_t kPrime1 = 0x9E3779B185EBCA87U, kPrime2 = 0xC2B2AE3D27D4EB4FU, kPrime3 = 0x165667B19E3779F9U,
                          kPrime4 = 0x85EBCA77C2B2AE63U, kPrime5 = 0x27D4EB2F165667C5U;
  const auto round = [](std::uint64_t lane, std::uint64_t word) { return std::rotl(lane + word * kPrime2, 31) * kPrime1; };
  const std::byte* at = bytes.data();
  std::size_t left = bytes.size();
  const auto next = [&]<class Word>(Word word) {
    std::memcpy(&word, at, sizeof word);
    at += sizeof word;
    left -= sizeof word;
    return std::uint64_t{word};
  };
  std::uint64_t hash = seed + kPrime5;
  if (left >= 32) {
    std::array<std::uint64_t, 4> lanes{seed + kPrime1 + kPrime2, seed + kPrime2, seed, seed - kPrime1};
    while (left >= 32) {
      for (std::uint64_t& lane : lanes) lane = round(lane, next(std::uint64_t{}));
    }
    hash = std::rotl(lanes[0], 1) + std::rotl(lanes[1], 7) + std::rotl(lanes[2], 12) + std::rotl(lanes[3], 18);
    for (const std::uint64_t lane : lanes) hash = (hash ^ round(0, lane)) * kPrime1 + kPrime4;
  }
  hash += bytes.size();
  while (left >= 8) hash = std::rotl(hash ^ round(0, next(std::uint64_t{})), 27) * kPrime1 + kPrime4;
  if (left >= 4) hash = std::rotl(hash ^ next(std::uint32_t{}) * kPrime1, 23) * kPrime2 + kPrime3;
  while (left > 0) hash = std::rotl(hash ^ next(std::uint8_t{}) * kPrime5, 11) * kPrime1;
  hash = (hash ^ (hash >> 33U)) * kPrime2;
  hash = (hash ^ (hash >> 29U)) * kPrime3;
  return hash ^ (hash >> 32U);
}

// Hashes a sequence of values. The hash so far is the seed for the next value. A hash also depends on the number of bytes, so
// moving a value from the end of one list to the beginning of the next changes it.
class Hash {
 public:
  std::uint64_t value() const { return value_; }

  void add(std::span<const std::byte> bytes) { value_ = xxh64(bytes, value_); }
  void add(std::string_view text) { add(std::as_bytes(std::span(text))); }
  // Adds the bytes of the values. Types with padding are not allowed, because equal values could then have different hashes.
  template <class T>
  void add(std::span<const T> values) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    add(std::as_bytes(values));
  }

  // Adds a number, an enumeration, a string, an array, a list or an optional. For a struct, adds each field that affects the
  // result of a step.
  template <class T>
  void add(const T& value) {
    if constexpr (std::is_arithmetic_v<T> || std::is_enum_v<T>) {
      add(std::span<const T>(&value, 1));
    } else if constexpr (std::is_convertible_v<const T&, std::string_view>) {
      add(std::string_view(value));
    } else if constexpr (HasFields<T>) {
      for_each_field(value, [this](const auto& field, const auto& part) {
        if (field.info.affects_hash == AffectsHash::no) return;
        add(std::string_view(field.name));
        add(part);
      });
    } else {
      add_parts(value);
    }
  }

 private:
  void add_parts(const WorldField& world) { add(hash_of_field(world)); }
  template <class T>
  void add_parts(const std::optional<T>& value) {
    add(value.has_value());
    if (value) add(*value);
  }
  template <class T>
  void add_parts(const std::vector<T>& values) {
    add(values.size());
    for (const T& value : values) add(value);
  }
  template <class T, std::size_t kSize>
  void add_parts(const std::array<T, kSize>& values) {
    for (const T& value : values) add(value);
  }

  std::uint64_t value_ = 0;
};

}  // namespace flockstep
