// EnvIndex and DroneIndex: the number of an env or of a drone in its batch. Neither is taken for the other by mistake.
#pragma once

#include <compare>
#include <concepts>
#include <cstddef>
#include <cstdint>

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

}  // namespace flockstep
