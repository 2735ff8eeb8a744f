// Field lists of structs. A struct lists its fields once; hashes, snapshots, keyword arguments and bindings read the list.
//
//   struct Wind {
//     float speed_mps = 0.0F;
//     static constexpr auto fields() {
//       return field_list(field("speed_mps", &Wind::speed_mps, {.about = "Mean speed.", .unit = "m/s", .limits = at_least(0)}));
//     }
//   };
//
// Checks, JSON, docstrings and the tables of configurations in the documents are also made from the list.
// for_each_field() does not compile for a struct that has more fields than its list.
#pragma once

#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>

#include "flockstep/limits.hpp"

namespace flockstep {

// Selects if a field is part of the configuration hash: `no` if batches that differ only in this field step identically.
enum class AffectsHash : bool { no, yes };

// Checks of a value that the limits of its numbers cannot express.
enum class Form : std::uint8_t { any, plain_name, unit_quaternion, direction };

// Description of a configuration's field. `about` consists of full sentences, with names and values in double backquotes.
struct FieldInfo {
  const char* about = "";                       // meaning of the field, in full sentences
  const char* unit = "";                        // unit of its values; empty: none
  Limits limits;                                // each number's, if the field is a list
  Form form = Form::any;                        // further checks of its value
  AffectsHash affects_hash = AffectsHash::yes;  // selects if it is part of the configuration hash
  const char* alias = nullptr;                  // name in messages, if different
  std::span<const Limits> each;                 // limits of each element of an array, instead of `limits`

  // Returns the description of one element of an array.
  constexpr FieldInfo of_element(std::size_t i) const {
    FieldInfo info = *this;
    if (!each.empty()) info.limits = each[i];
    return info;
  }
};

// An entry of a list: a member of a struct and its description.
template <class Struct, class Value>
struct FieldPointer {
  const char* name;        // name of the field
  Value Struct::* member;  // the member
  FieldInfo info;          // its description
};

// Returns an entry for a list.
template <class Struct, class Value>
constexpr FieldPointer<Struct, Value> field(const char* name, Value Struct::* member, const FieldInfo& info = {}) {
  return {name, member, info};
}

namespace detail {

template <std::size_t I, class Field>
struct FieldAt {
  Field field;
};
template <std::size_t I, class Field>
constexpr const Field& at(const FieldAt<I, Field>& entry) {
  return entry.field;
}

// A list of entries. A std::tuple would check for each how it may be constructed, which is a tenth of the compiler's time.
template <class Indices, class... Fields>
struct FieldList;
template <std::size_t... I, class... Fields>
struct FieldList<std::index_sequence<I...>, Fields...> : FieldAt<I, Fields>... {
  static constexpr std::size_t kSize = sizeof...(Fields);

  // Calls f with all entries.
  template <class F>
  constexpr decltype(auto) apply(F&& f) const {
    return std::forward<F>(f)(at<I>(*this)...);
  }

  // Returns entry K.
  template <std::size_t K>
  constexpr const auto& get() const {
    return at<K>(*this);
  }
};

}  // namespace detail

// Returns a list of entries.
template <class... Fields>
constexpr auto field_list(const Fields&... fields) {
  return detail::FieldList<std::index_sequence_for<Fields...>, Fields...>{{fields}...};
}

template <class T>
concept HasFields = requires { T::fields(); };

// Names of the members 0, 1, ... of an enumeration. Each specialisation stands next to its enumeration and defines `kNames`, an
// array of const char*.
template <class Enum>
struct EnumNames;

namespace detail {

// Converts to the type of any field.
struct Anything {
  template <class T>
  operator T&() const& noexcept;
  template <class T>
  operator T&&() const&& noexcept;
};
template <std::size_t>
using AnythingAt = Anything;

template <class T, std::size_t... I>
consteval bool takes(std::index_sequence<I...>) {
  return requires { T{AnythingAt<I>{}...}; };
}

}  // namespace detail

// Returns true if an aggregate without base classes has `count` fields: if the longest initialiser list that compiles is as long.
template <class T, std::size_t kCount>
consteval bool has_fields() {
  static_assert(std::is_aggregate_v<T>);
  return detail::takes<T>(std::make_index_sequence<kCount>()) && !detail::takes<T>(std::make_index_sequence<kCount + 1>());
}

// Returns true if the list of a struct has as many entries as the struct has fields.
template <HasFields T>
consteval bool lists_every_field() {
  return has_fields<T, decltype(T::fields())::kSize>();
}

// The field list of a struct, built at compile time.
template <HasFields T>
inline constexpr auto kFields = T::fields();

namespace detail {

template <HasFields T>
consteval bool are_all_bools() {
  return kFields<T>.apply(
      []<class... Values>(const FieldPointer<T, Values>&...) { return (std::is_same_v<Values, bool> && ...); });
}

}  // namespace detail

// A struct of bools, such as CameraOutputs. In Python and JSON it is a list of the names of the true ones.
template <class T>
concept SetOfNames = HasFields<T> && detail::are_all_bools<T>();

// Calls f(field, value) for each field in order; `object` may be const.
template <class T, class F>
constexpr void for_each_field(T& object, F&& f) {
  using Struct = std::remove_const_t<T>;
  static_assert(lists_every_field<Struct>(), "fields() has to list every field of the struct");
  kFields<Struct>.apply([&](const auto&... fields) { (f(fields, object.*(fields.member)), ...); });
}

}  // namespace flockstep
