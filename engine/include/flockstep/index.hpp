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

// Index of an env or a drone in its batch.
template <class Kind>
class Index {
 public:
  constexpr Index() = default;
  // From an integer in [0, 2^32).
  template <std::integral T>
  constexpr explicit Index(T value) : value_(static_cast<std::uint32_t>(value)) {}

  // The index as a number.
  constexpr operator std::size_t() const { return value_; }  // NOLINT: it indexes arrays
  friend constexpr bool operator==(Index, Index) = default;
  // Compares the numbers.
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
  // A view of one flag for each env or drone; the flags must outlive it.
  constexpr Mask(std::span<const std::uint8_t> flags) : flags_(flags) {}  // NOLINT: any flags of the right number are one
  // A view of a container of flags, which must outlive it.
  template <class Flags>
    requires std::convertible_to<const Flags&, std::span<const std::uint8_t>>
  constexpr Mask(const Flags& flags) : flags_(flags) {}  // NOLINT

  constexpr bool empty() const { return flags_.empty(); }       // true if it selects all
  constexpr std::size_t size() const { return flags_.size(); }  // number of flags; 0 if it is empty
  constexpr bool selects(Index<Kind> index) const {
    return flags_.empty() || flags_[index];
  }  // true if it selects this env or drone; the index is not checked

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
