// Converts arrays between Python and C++: checked spans in, views out.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "flockstep/pose.hpp"

namespace flockstep::bindings {

namespace py = pybind11;
using Shape = std::vector<py::ssize_t>;

// Throws ValueError for a masked array: its mask would be lost.
inline void refuse_masked(const py::handle& value, const std::string& field) {
  PyTypeObject* const array = py::detail::npy_api::get().PyArray_Type_;
  if (Py_TYPE(value.ptr()) == array || PyObject_TypeCheck(value.ptr(), array) == 0) return;
  if (!py::isinstance(value, py::module_::import("numpy").attr("ma").attr("MaskedArray"))) return;
  throw py::value_error(field + ": expected an array without a mask, got a masked array: call filled() first");
}

// Any length, -1, is N in the first dimension, K in the second.
inline std::string text_of(const Shape& shape) {
  std::string text = py::str(py::tuple(py::cast(shape)));
  for (std::size_t at = text.find("-1"); at != std::string::npos; at = text.find("-1")) text.replace(at, 2, at == 1 ? "N" : "K");
  return text;
}

// Selects if a single row stands for all rows of an array.
enum class OneForAll : bool { no, yes };

// An array argument as contiguous T; empty for None. `kinds` are NumPy's: 'b' bool, 'i' and 'u' integer, 'f' float.
template <class T>
class Input {
  using Array = py::array_t<T, py::array::c_style | py::array::forcecast>;

 public:
  // -1 in the shape allows any length in that dimension.
  Input(const py::object& object, const char* field, const Shape& shape, const char* kinds, const char* kinds_text,
        OneForAll one_for_all = OneForAll::no) {
    if (object.is_none()) return;
    refuse_masked(object, field);
    py::array any = read(object, field, kinds_text);
    if (one_for_all == OneForAll::yes && is_one_row(any, shape)) {
      any = py::module_::import("numpy").attr("broadcast_to")(any, py::tuple(py::cast(shape)));
    }
    if (std::string_view(kinds).find(any.dtype().kind()) == std::string_view::npos) {
      refuse(field, std::string("an array of ") + kinds_text, std::string("dtype ") + std::string(py::str(any.dtype())));
    }
    const std::span got(any.shape(), static_cast<std::size_t>(any.ndim()));
    const bool fits =
        std::ranges::equal(shape, got, [](py::ssize_t want, py::ssize_t have) { return want == -1 || want == have; });
    if (!fits) refuse(field, "shape " + text_of(shape), "shape " + text_of(Shape(got.begin(), got.end())));
    if (py::isinstance<Array>(any)) {
      array_ = py::reinterpret_borrow<Array>(any);
      return;
    }
    if constexpr (std::is_same_v<T, float>) {
      if (any.dtype().kind() == 'f' && any.dtype().itemsize() > 4) require_float_range(field, any);
    } else if constexpr (std::is_integral_v<T> && sizeof(T) > 1) {
      if (any.dtype().kind() == 'u') {
        require_integer_range<std::uint64_t>(field, any);
      } else {
        require_integer_range<std::int64_t>(field, any);
      }
    }
    array_.emplace(any);
  }

  operator std::span<const T>() const {  // NOLINT: a span is what this is for
    return array_ ? std::span<const T>(array_->data(), static_cast<std::size_t>(array_->size())) : std::span<const T>();
  }
  bool given() const { return array_.has_value(); }
  std::size_t rows() const { return static_cast<std::size_t>(array_->shape(0)); }

 private:
  // Returns true for a row (columns,) or (1, columns) of the shape (rows, columns).
  static bool is_one_row(const py::array& any, const Shape& shape) {
    return any.ndim() > 0 && any.ndim() <= 2 && any.shape(any.ndim() - 1) == shape.back() && any.size() == shape.back();
  }
  [[noreturn]] static void refuse(const char* field, const std::string& expected, const std::string& got) {
    throw py::value_error(std::string(field) + ": expected " + expected + ", got " + got);
  }
  static py::array read(const py::object& object, const char* field, const char* kinds_text) {
    try {
      return py::array(object);
    } catch (const py::error_already_set& error) {  // for example, a tensor that requires grad
      const std::string why = py::str(error.value());
      refuse(field, std::string("an array of ") + kinds_text, std::string(py::str(py::type::of(object))) + " (" + why + ")");
    }
  }
  // Otherwise a double beyond float32's range would become infinite, with a NumPy warning that does not name the field.
  static void require_float_range(const char* field, const py::array_t<double, py::array::c_style | py::array::forcecast>& wide) {
    for (py::ssize_t i = 0; i < wide.size(); ++i) {
      const double value = wide.data()[i];
      if (std::isfinite(value) && std::abs(value) > static_cast<double>(std::numeric_limits<float>::max())) {
        refuse(field, "finite numbers in float32's range", py::str(py::float_(value)));
      }
    }
  }

  // Otherwise NumPy would truncate integers beyond T's range to their low bits.
  template <class Wide>
  static void require_integer_range(const char* field, const py::array_t<Wide, py::array::c_style | py::array::forcecast>& wide) {
    if constexpr (std::is_same_v<Wide, T>) return;
    for (py::ssize_t i = 0; i < wide.size(); ++i) {
      if (std::in_range<T>(wide.data()[i])) continue;
      refuse(field,
             "integers from " + std::to_string(std::numeric_limits<T>::min()) + " to " +
                 std::to_string(std::numeric_limits<T>::max()),
             std::to_string(wide.data()[i]));
    }
  }

  std::optional<Array> array_;
};

inline Input<float> floats(const py::object& object, const char* field, const Shape& shape) {
  return {object, field, shape, "fiu", "real numbers"};
}
// Returns (rows, columns) numbers. One row, (columns,) or (1, columns), stands for all.
inline Input<float> row_floats(const py::object& object, const char* field, py::ssize_t rows, py::ssize_t columns) {
  return {object, field, {rows, columns}, "fiu", "real numbers", OneForAll::yes};
}
template <class T>
Input<T> integers(const py::object& object, const char* field, const Shape& shape) {
  return {object, field, shape, "iu", "integers"};
}

// Returns a bool mask as bytes.
inline Input<std::uint8_t> flags(const py::object& object, const char* field, py::ssize_t n) {
  return {object, field, {n}, "b", "bool"};
}

// Returns a view of memory that `owner` keeps alive. Every step creates some views, so this calls NumPy directly: py::array_t
// would compute strides and flags that NumPy computes again.
inline py::object view(const py::object& owner, py::dtype dtype, const void* data, std::span<const py::ssize_t> shape,
                       bool writable = false) {
  using Api = py::detail::npy_api;
  Api& numpy = Api::get();
  const int flags = Api::NPY_ARRAY_C_CONTIGUOUS_ | Api::NPY_ARRAY_ALIGNED_ | (writable ? Api::NPY_ARRAY_WRITEABLE_ : 0);
  PyObject* const array = numpy.PyArray_NewFromDescr_(numpy.PyArray_Type_, dtype.release().ptr(), static_cast<int>(shape.size()),
                                                      reinterpret_cast<const Py_intptr_t*>(shape.data()), nullptr,
                                                      const_cast<void*>(data), flags, nullptr);
  if (array == nullptr) throw py::error_already_set();
  auto view = py::reinterpret_steal<py::object>(array);
  if (numpy.PyArray_SetBaseObject_(array, py::object(owner).release().ptr()) != 0) throw py::error_already_set();
  return view;
}
template <class T, class Stored>
py::array_t<T> view(const py::object& owner, const Stored* data, std::span<const py::ssize_t> shape, bool writable = false) {
  static_assert(sizeof(T) == sizeof(Stored));
  return py::reinterpret_steal<py::array_t<T>>(view(owner, py::dtype::of<T>(), data, shape, writable).release());
}
template <class T, class Stored>
py::array_t<T> view(const py::object& owner, const Stored* data, std::initializer_list<py::ssize_t> shape,
                    bool writable = false) {
  return view<T>(owner, data, std::span(shape.begin(), shape.size()), writable);
}

// Returns a copy of a list as an array.
template <class List>
auto array_of(const List& values) {
  return py::array_t<std::remove_cvref_t<decltype(values[0])>>(std::ssize(values), values.data());
}

// Returns the rows of an (R, 3) array as points.
inline std::vector<Vec3> points_of(std::span<const float> rows) {
  std::vector<Vec3> points;
  for (std::size_t i = 0; i + 2 < rows.size(); i += 3) points.emplace_back(rows[i], rows[i + 1], rows[i + 2]);
  return points;
}

// Returns points as an (R, 3) array.
inline py::array_t<float> rows(std::span<const Vec3> points) {
  py::array_t<float> array({static_cast<py::ssize_t>(points.size()), py::ssize_t{3}});
  float* out = array.mutable_data();
  for (const Vec3& point : points) out = std::copy_n(point.data(), 3, out);
  return array;
}

}  // namespace flockstep::bindings
