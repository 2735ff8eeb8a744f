// Field: declares a named array of a task, such as an observation. Buffer: holds the values of a field, row by row.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <numeric>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

// Type of the values of an array.
enum class DType : std::uint8_t { boolean, uint8, int32, int64, float32, float64 };
template <>
struct EnumNames<DType> {
  static constexpr std::array kNames{"bool", "uint8", "int32", "int64", "float32", "float64"};
};

// The DType of a C++ type; uint8 for every type that has none of its own.
template <class T>
inline constexpr DType kDType = DType::uint8;
template <>
inline constexpr DType kDType<bool> = DType::boolean;
template <>
inline constexpr DType kDType<std::int32_t> = DType::int32;
template <>
inline constexpr DType kDType<std::int64_t> = DType::int64;
template <>
inline constexpr DType kDType<float> = DType::float32;
template <>
inline constexpr DType kDType<double> = DType::float64;

// True if a C++ type has a DType.
template <class T>
inline constexpr bool is_dtype = std::is_same_v<T, std::uint8_t> || kDType<T> != DType::uint8;

// Returns true for float32 and float64.
constexpr bool is_floating(DType type) { return type == DType::float32 || type == DType::float64; }

// Returns the size of a value in bytes.
constexpr std::size_t size_of(DType type) {
  switch (type) {
    case DType::boolean:
    case DType::uint8:
      return 1;
    case DType::int32:
    case DType::float32:
      return 4;
    default:
      return 8;
  }
}

// Name, type, shape and bounds of one row of an array.
struct Field {
  std::string name;                 // key in a dict of several fields; empty for a single one
  DType type = DType::float32;      // type of the values
  std::vector<std::int64_t> shape;  // shape per row; empty: a scalar
  // Minimum and maximum: one for the whole row, or one for each of its values.
  std::vector<double> low{-1.0};
  std::vector<double> high{1.0};    // see low
  std::vector<double> absent{0.0};  // value of a removed drone's row: one for the row, or one for each value

  static constexpr auto fields() {
    using C = Field;
    return field_list(field("name", &C::name), field("type", &C::type), field("shape", &C::shape), field("low", &C::low),
                      field("high", &C::high), field("absent", &C::absent));
  }

  // Returns the number of values of one row.
  std::size_t size() const {
    return static_cast<std::size_t>(std::accumulate(shape.begin(), shape.end(), std::int64_t{1}, std::multiplies<>()));
  }
};

// Values of a field, row by row.
class Buffer {
 public:
  Buffer() = default;
  // Makes rows of zeros for a field.
  Buffer(const Field& field, std::size_t rows)
      : type_(field.type), columns_(field.size()), bytes_(rows * columns_ * size_of(field.type)) {}

  DType type() const { return type_; }                                 // type of the values
  std::size_t columns() const { return columns_; }                     // values per row
  std::size_t row_bytes() const { return columns_ * size_of(type_); }  // bytes per row
  // All rows as bytes.
  AlignedVector<std::byte>& bytes() { return bytes_; }
  const AlignedVector<std::byte>& bytes() const { return bytes_; }

  // Returns one row. T must be the type of the field.
  template <class T>
  std::span<T> row(std::size_t index) {
    return {reinterpret_cast<T*>(bytes_.data()) + index * columns_, columns_};
  }
  template <class T>
  std::span<const T> row(std::size_t index) const {
    return {reinterpret_cast<const T*>(bytes_.data()) + index * columns_, columns_};
  }
  // Returns one row as bytes. The index is not checked.
  std::span<std::byte> row_as_bytes(std::size_t index) { return {bytes_.data() + index * row_bytes(), row_bytes()}; }
  // Copies one row from a buffer of the same field. The index is not checked.
  void copy_row(std::size_t index, const Buffer& from) {
    const std::size_t size = row_bytes();
    std::memcpy(bytes_.data() + index * size, from.bytes_.data() + index * size, size);
  }

 private:
  DType type_ = DType::float32;
  std::size_t columns_ = 0;  // values per row
  AlignedVector<std::byte> bytes_;
};

}  // namespace flockstep
