// Properties that view the arrays of a struct, made from its list.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <algorithm>
#include <cstddef>
#include <span>
#include <string>
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

inline Shape shape_of(const ArrayView& array) {
  const int columns = array.info.columns;
  const ItemShape& items = array.items;
  Shape shape{0};
  if (columns > 0 && items.columns_first) shape.push_back(columns);
  if (array.info.per != Per::row) shape.insert(shape.end(), items.sizes.begin(), items.sizes.begin() + items.dimensions);
  if (columns > 0 && !items.columns_first) shape.push_back(columns);
  py::ssize_t width = 1;
  for (std::size_t i = 1; i < shape.size(); ++i) width *= shape[i];
  shape[0] = static_cast<py::ssize_t>(array.size) / std::max<py::ssize_t>(width, 1);
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

// Adds a property for each array of the list that is not internal. get(self, name) returns a Viewed; it throws if the object has
// no such array. Descriptions of the arrays are added to the list cls._arrays.
template <HasFields Arrays, class Class, class Get>
void add_arrays(Class& cls, const Get& get) {
  const auto property = py::reinterpret_borrow<py::object>(reinterpret_cast<PyObject*>(&PyProperty_Type));
  const py::is_method method(cls);
  if (!cls.attr("__dict__").contains("_arrays")) cls.attr("_arrays") = py::list();
  py::list descriptions = cls.attr("_arrays");
  std::size_t index = 0;
  for_each_view(Arrays{}, {}, [&](const ArrayView& listed) {
    const std::size_t wanted = index++;
    if (listed.info.access == Access::internal) return;
    const auto read = [get, wanted, name = listed.name, dtype = dtype_of(listed)](const py::object& self) {
      const Viewed<Arrays> viewed = get(self, name);
      py::object array;
      std::size_t at = 0;
      for_each_view(viewed.arrays, viewed.items, [&](const ArrayView& found) {
        if (at++ != wanted) return;
        array = view(viewed.owner, dtype, found.data, shape_of(found), found.info.access == Access::write);
      });
      return array;
    };
    cls.attr(listed.name) = property(py::cpp_function(read, method));
    descriptions.append(description_of(listed));
  });
}

}  // namespace flockstep::bindings
