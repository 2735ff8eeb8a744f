// EnvIndex and DroneIndex: the index of an env or drone in its batch, and masks over them. They are distinct types, so code
// that mixes them up does not compile.
#pragma once

#include <array>
#include <compare>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/fields.hpp"

namespace flockstep {

template <class Kind>
class Index {
 public:
  constexpr Index() = default;
  template <std::integral T>
  constexpr explicit Index(T value) : value_(static_cast<std::uint32_t>(value)) {}

  constexpr operator std::size_t() const { return value_; }  // NOLINT: it indexes arrays
  friend constexpr bool operator==(Index, Index) = default;
  friend constexpr auto operator<=>(Index, Index) = default;

 private:
  std::uint32_t value_ = 0;
};

using EnvIndex = Index<struct EnvKind>;      // below E
using DroneIndex = Index<struct DroneKind>;  // below N = E M; drone d belongs to env d / M

// Flags that select envs or drones, one for each: 0 or 1. An empty mask selects all of them.
template <class Kind>
class Mask {
 public:
  constexpr Mask() = default;
  constexpr Mask(std::span<const std::uint8_t> flags) : flags_(flags) {}  // NOLINT: any flags of the right number are one
  template <class Flags>
    requires std::convertible_to<const Flags&, std::span<const std::uint8_t>>
  constexpr Mask(const Flags& flags) : flags_(flags) {}  // NOLINT

  constexpr bool empty() const { return flags_.empty(); }
  constexpr std::size_t size() const { return flags_.size(); }
  constexpr bool selects(Index<Kind> index) const { return flags_.empty() || flags_[index]; }

 private:
  std::span<const std::uint8_t> flags_;
};

using EnvMask = Mask<struct EnvKind>;      // (E,)
using DroneMask = Mask<struct DroneKind>;  // (N,)

// Owner of a row of an array.
enum class Row : std::uint8_t { drone, env };
template <>
struct EnumNames<Row> {
  static constexpr std::array kNames{"drone", "env"};
};

}  // namespace flockstep
