// Adds properties that view the arrays of a struct, based on its list of fields.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <array>
#include <cstddef>
#include <span>
#include <utility>

#include "flockstep/arrays.hpp"

namespace flockstep::bindings {

namespace py = pybind11;

// The arrays that a property reads, and the object that owns their memory.
template <class Arrays>
struct Viewed {
  const Arrays& arrays;
  py::object owner;
  ItemShape items = {};
};

py::dtype dtype_of(const ArrayView& array);

// Type-erased Viewed, so that add_array() is not a template: each bound function costs a tenth of a second of compile time.
struct AnyViewed {
  const void* arrays;
  py::object owner;
  ItemShape items;
};
using GetArrays = AnyViewed (*)(const py::object& self, const char* name);
using ViewArray = ArrayView (*)(const void* arrays, const ItemShape& items);

// Adds a property for an array, and adds its description to the list cls._arrays. `listed` is the array of an empty struct.
void add_array(const py::object& cls, const ArrayView& listed, ViewArray view, GetArrays get);

// Returns the array at an index of the list.
template <HasFields Arrays, std::size_t kIndex>
ArrayView view_at(const void* arrays, const ItemShape& items) {
  constexpr auto kEntry = kFields<Arrays>.template get<kIndex>();
  return view_of(kEntry, static_cast<const Arrays*>(arrays)->*kEntry.member, items);
}

// Adds a property for each non-internal array of the list. kGet throws if the object has no such array.
template <HasFields Arrays, Viewed<Arrays> (*kGet)(const py::object& self, const char* name)>
void add_arrays(const py::object& cls) {
  const GetArrays get = [](const py::object& self, const char* name) -> AnyViewed {
    Viewed<Arrays> viewed = kGet(self, name);
    return {&viewed.arrays, std::move(viewed.owner), viewed.items};
  };
  [&]<std::size_t... kIndex>(std::index_sequence<kIndex...>) {
    const Arrays empty;
    const auto add_if_listed = [&]<std::size_t kAt>(std::integral_constant<std::size_t, kAt>) {
      if constexpr (requires { kFields<Arrays>.template get<kAt>().info.writer; }) {
        add_array(cls, view_at<Arrays, kAt>(&empty, {}), &view_at<Arrays, kAt>, get);
      }
    };
    (add_if_listed(std::integral_constant<std::size_t, kIndex>()), ...);
  }(std::make_index_sequence<kFields<Arrays>.kSize>());
}

}  // namespace flockstep::bindings
