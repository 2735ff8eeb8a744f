// Lists of a batch's arrays. A struct of arrays lists its members once, in fields(), with array(). Allocation, snapshots and
// their checks, NumPy views, the stub and the table in docs/reference/arrays.md are made from these lists.
//
//   struct Battery {
//     std::vector<float> charge;  // (N,)
//     static constexpr auto fields() {
//       return field_list(array("charge", &Battery::charge, {.unit = "C", .writer = "step", .about = "charge left"}));
//     }
//   };
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "flockstep/buffer.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Kind of an array's rows. EnumNames are the row counts: N drones, E envs, R, which is N or E depending on TaskSpec::row, and B
// bodies of each env.
enum class Rows : std::uint8_t { drone, env, task, body };
template <>
struct EnumNames<Rows> {
  static constexpr std::array kNames{"N", "E", "R", "E, B"};
};

// Frame of reference of vectors and quaternions.
enum class Frame : std::uint8_t { none, world, body, sensor };
template <>
struct EnumNames<Frame> {
  static constexpr std::array kNames{"", "world", "body", "sensor"};
};

// Values that an array may hold. Restoring a snapshot with other values is refused.
enum class Values : std::uint8_t {
  finite,      // finite numbers
  any,         // any number, including NaN and infinities
  flag,        // 0 or 1, viewed as bool
  count,       // 0 to 2^62
  last_count,  // a count, or -1 for none yet
  fraction,    // 0 to 1
  range,       // 0 to infinity
};

// Access to an array by its name.
enum class Access : std::uint8_t {
  read,      // read-only views
  write,     // views of the latest outputs are writable
  internal,  // no view
};

// Items of a row; each item has the array's columns. EnumNames are the dimensions of the items in a shape.
enum class Per : std::uint8_t {
  row,    // the row is a single item
  term,   // terms of the reward
  ray,    // rays of a LiDAR
  pixel,  // pixels of a camera image
  rotor,  // rotors of a drone
};
template <>
struct EnumNames<Per> {
  static constexpr std::array kNames{"", "terms", "channels, beams", "height, width", "rotors"};
};

// Description of an array in a list.
struct ArrayInfo {
  Rows rows = Rows::drone;         // kind of its rows
  Per per = Per::row;              // items of a row
  int columns = 0;                 // values per item; 0: an item is a scalar
  const char* unit = "";           // unit of the values; empty: none
  Frame frame = Frame::none;       // frame of reference
  Values values = Values::finite;  // values that it may hold
  Access access = Access::read;    // access by its name
  const char* writer = "";         // stage of the step, or call, that writes the array
  const char* about = "";          // short description
};

// An entry of a list: a member of a struct and its description.
template <class Struct, class Array>
struct ArrayPointer {
  const char* name;        // name of the view, unique in a batch
  Array Struct::* member;  // the member
  ArrayInfo info;          // its description
};

// Returns an entry for a list.
template <class Struct, class Array>
constexpr ArrayPointer<Struct, Array> array(const char* name, Array Struct::* member, ArrayInfo info) {
  return {name, member, info};
}

// Row and item counts of a batch.
struct ArraySizes {
  std::size_t num_envs = 0;       // E
  std::size_t num_drones = 0;     // N
  std::size_t num_task_rows = 0;  // R: N or E
  std::size_t num_bodies = 0;     // E B
  std::size_t num_terms = 0;      // terms of the reward
  std::size_t num_rays = 0;       // rays of a LiDAR, of one drone
  std::size_t num_pixels = 0;     // pixels of a camera's image
  std::size_t num_rotors = 0;     // of the drones, the largest number

  // Returns the number of rows of this kind.
  std::size_t rows(Rows of) const {
    return std::array{num_drones, num_envs, num_task_rows, num_bodies}[static_cast<std::size_t>(of)];
  }
  // Returns the number of values per row.
  std::size_t width(const ArrayInfo& info) const {
    const std::size_t items = info.per == Per::term    ? num_terms
                              : info.per == Per::ray   ? num_rays
                              : info.per == Per::pixel ? num_pixels
                              : info.per == Per::rotor ? num_rotors
                                                       : 1;
    return items * (info.columns == 0 ? 1 : static_cast<std::size_t>(info.columns));
  }
};

// Calls f(entry, values) for each member listed with array(). Other members, such as nested structs, are skipped.
template <HasFields T, class F>
void for_each_listed(T& arrays, const F& f) {
  for_each_field(arrays, [&](const auto& entry, auto& values) {
    if constexpr (requires { entry.info.writer; }) f(entry, values);
  });
}

// Returns the value of an empty entry: infinity for ranges, otherwise 0.
template <class T>
constexpr T absent_value(const ArrayInfo& info) {
  return info.values == Values::range ? std::numeric_limits<T>::infinity() : T{};
}

// Resizes an array and fills it with absent values.
template <class Entry, class Array>
void allocate(const Entry& entry, Array& values, const ArraySizes& sizes) {
  values.assign(sizes.rows(entry.info.rows) * sizes.width(entry.info), absent_value<typename Array::value_type>(entry.info));
}
template <HasFields T>
void allocate(T& arrays, const ArraySizes& sizes) {
  for_each_listed(arrays, [&](const auto& entry, auto& values) { allocate(entry, values, sizes); });
}

// Returns arrays of these sizes with absent values.
template <HasFields T>
T allocated(const ArraySizes& sizes) {
  T arrays;
  allocate(arrays, sizes);
  return arrays;
}

// Shape of the items of a row: terms, channels x beams, height x width, or rotors.
struct ItemShape {
  std::array<std::int64_t, 2> sizes{1, 1};  // number of items along each dimension
  std::size_t dimensions = 0;               // number of dimensions, 0 to 2
  bool columns_first = false;               // the columns come before the items, as in chw images
  std::array<std::int64_t, 2> bodies{};     // E and B, for Rows::body
};

// Memory and description of a listed array.
struct ArrayView {
  const char* name;        // name of the view
  ArrayInfo info;          // description of the array
  char kind;               // NumPy's kind of the values: b bool, i and u integer, f floating-point
  std::size_t value_size;  // bytes per value
  const void* data;        // the first value
  std::size_t size;        // number of values
  ItemShape items;         // unused if info.per is Per::row
};

// Returns the view of a listed array.
template <class Entry, class Array>
ArrayView view_of(const Entry& entry, const Array& values, const ItemShape& items) {
  using Value = typename Array::value_type;
  const char kind = entry.info.values == Values::flag ? 'b'
                    : std::is_floating_point_v<Value> ? 'f'
                    : std::is_signed_v<Value>         ? 'i'
                                                      : 'u';
  return {entry.name, entry.info, kind, sizeof(Value), values.data(), values.size(), items};
}

// Calls f(view) for each listed array.
template <HasFields T, class F>
void for_each_view(const T& arrays, const ItemShape& items, const F& f) {
  for_each_listed(arrays, [&](const auto& entry, const auto& values) { f(view_of(entry, values, items)); });
}

// Throws std::invalid_argument, naming the array, if a value is not among the allowed ones.
FLOCKSTEP_API void check_values(std::span<const std::uint8_t> values, const char* name, Values allowed);
FLOCKSTEP_API void check_values(std::span<const std::uint16_t> values, const char* name, Values allowed);
FLOCKSTEP_API void check_values(std::span<const std::int32_t> values, const char* name, Values allowed);
FLOCKSTEP_API void check_values(std::span<const std::int64_t> values, const char* name, Values allowed);
FLOCKSTEP_API void check_values(std::span<const std::uint64_t> values, const char* name, Values allowed);
FLOCKSTEP_API void check_values(std::span<const float> values, const char* name, Values allowed);
FLOCKSTEP_API void check_values(std::span<const double> values, const char* name, Values allowed);

// Checks the values of all listed arrays. Throws std::invalid_argument, naming the array, on a value that is not allowed.
template <HasFields T>
void check_arrays(const T& arrays) {
  for_each_listed(arrays,
                  [](const auto& entry, const auto& values) { check_values(std::span(values), entry.name, entry.info.values); });
}

}  // namespace flockstep
