// Properties that view the arrays of a struct, made from its list.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>

#include "arrays.hpp"
#include "convert.hpp"
#include "flockstep/arrays.hpp"

namespace flockstep::bindings {

// The arrays that a property reads, and the object that keeps their memory alive.
template <class Arrays>
struct Viewed {
  const Arrays& arrays;
  py::object owner;
  ItemShape items = {};
};

// The shape of a view, without an allocation: every step makes some views.
struct ViewShape {
  std::array<py::ssize_t, 4> sizes{};
  std::size_t dimensions = 1;

  void add(py::ssize_t size) { sizes[dimensions++] = size; }
  std::span<const py::ssize_t> span() const { return std::span(sizes).first(dimensions); }
};

inline ViewShape shape_of(const ArrayView& array) {
  const int columns = array.info.columns;
  const ItemShape& items = array.items;
  ViewShape shape;
  if (columns > 0 && items.columns_first) shape.add(columns);
  for (std::size_t i = 0; array.info.per != Per::row && i < items.dimensions; ++i) shape.add(items.sizes[i]);
  if (columns > 0 && !items.columns_first) shape.add(columns);
  py::ssize_t width = 1;
  for (std::size_t i = 1; i < shape.dimensions; ++i) width *= shape.sizes[i];
  shape.sizes[0] = static_cast<py::ssize_t>(array.size) / std::max<py::ssize_t>(width, 1);
  return shape;
}

inline py::dtype dtype_of(const ArrayView& array) {
  return py::dtype(array.kind == 'b' ? "?" : array.kind + std::to_string(array.value_size));
}

// The array as a document has it: "(N, 3)".
inline std::string shape_text(const ArrayInfo& info) {
  std::string text = std::string("(") + name_of(info.rows);
  if (info.per != Per::row) text += std::string(", ") + name_of(info.per);
  if (info.columns > 0) text += ", " + std::to_string(info.columns);
  return text + (text.find(',') == std::string::npos ? ",)" : ")");
}

// For the stub and the documents' table.
inline py::dict description_of(const ArrayView& array) {
  py::dict entry;
  entry["name"] = array.name;
  entry["dtype"] = dtype_of(array).attr("name");
  entry["shape"] = shape_text(array.info);
  entry["unit"] = array.info.unit;
  entry["frame"] = name_of(array.info.frame);
  entry["writer"] = array.info.writer;
  entry["about"] = array.info.about;
  entry["writable"] = array.info.access == Access::write;
  return entry;
}

// The array at an index of the list.
template <HasFields Arrays, std::size_t kIndex>
ArrayView view_at(const Arrays& arrays, const ItemShape& items) {
  constexpr auto kEntry = std::get<kIndex>(Arrays::fields());
  return view_of(kEntry, arrays.*kEntry.member, items);
}

// Adds a property for each array of the list that is not internal. get(self, name) returns a Viewed; it throws if the object has
// no such array. Descriptions of the arrays are added to the list cls._arrays.
template <HasFields Arrays, class Class, class Get>
void add_arrays(Class& cls, const Get& get) {
  const auto property = py::reinterpret_borrow<py::object>(reinterpret_cast<PyObject*>(&PyProperty_Type));
  const py::is_method method(cls);
  if (!cls.attr("__dict__").contains("_arrays")) cls.attr("_arrays") = py::list();
  py::list descriptions = cls.attr("_arrays");
  const auto add = [&](ArrayView (*view_now)(const Arrays&, const ItemShape&)) {
    const ArrayView listed = view_now({}, {});
    if (listed.info.access == Access::internal) return;
    const auto read = [get, view_now, name = listed.name, dtype = dtype_of(listed)](const py::object& self) {
      const Viewed<Arrays> viewed = get(self, name);
      const ArrayView now = view_now(viewed.arrays, viewed.items);
      return view(viewed.owner, dtype, now.data, shape_of(now).span(), now.info.access == Access::write);
    };
    cls.attr(listed.name) = property(py::cpp_function(read, method));
    descriptions.append(description_of(listed));
  };
  [&]<std::size_t... kIndex>(std::index_sequence<kIndex...>) {
    const auto add_if_listed = [&]<std::size_t kAt>(std::integral_constant<std::size_t, kAt>) {
      if constexpr (requires { std::get<kAt>(Arrays::fields()).info.writer; }) add(&view_at<Arrays, kAt>);
    };
    (add_if_listed(std::integral_constant<std::size_t, kIndex>()), ...);
  }(std::make_index_sequence<std::tuple_size_v<decltype(Arrays::fields())>>());
}

}  // namespace flockstep::bindings
