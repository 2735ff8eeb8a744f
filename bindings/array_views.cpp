#include "array_views.hpp"

#include <algorithm>
#include <memory>
#include <string>
#include <string_view>

#include "arrays.hpp"
#include "base/array_shape.hpp"
#include "convert.hpp"

namespace flockstep::bindings {

py::dtype dtype_of(const ArrayView& array) {
  return py::dtype(array.kind == 'b' ? "?" : array.kind + std::to_string(array.value_size));
}

namespace {

// Returns the shape as documents show it: "(N, 3)".
std::string shape_text(const ArrayInfo& info) {
  std::string text = std::string("(") + name_of(info.rows);
  if (info.per != Per::row) text += std::string(", ") + name_of(info.per);
  if (info.columns > 0) text += ", " + std::to_string(info.columns);
  return text + (text.find(',') == std::string::npos ? ",)" : ")");
}

// Returns NumPy's name for a kind of numbers, without importing NumPy: the build makes the stub with a Python that may lack it.
std::string type_name(char kind) { return kind == 'f' ? "float" : kind == 'i' ? "int" : "uint"; }

// Returns the name of an array's attribute. Those of bodies are attributes of batch.bodies.
std::string attribute_of(const ArrayView& array) {
  constexpr std::string_view kPrefix = "body_";
  const std::string name = array.name;
  return array.info.rows == Rows::body && name.starts_with(kPrefix) ? name.substr(kPrefix.size()) : name;
}

// Returns the description of an array for the stub and the tables in the documents.
py::dict description_of(const ArrayView& array) {
  py::dict entry;
  entry["name"] = attribute_of(array);
  entry["dtype"] = array.kind == 'b' ? "bool" : type_name(array.kind) + std::to_string(8 * array.value_size);
  entry["shape"] = shape_text(array.info);
  entry["unit"] = array.info.unit;
  entry["frame"] = name_of(array.info.frame);
  entry["writer"] = array.info.writer;
  entry["about"] = array.info.about;
  const std::string unit = *array.info.unit == '\0' ? "" : std::string(" ") + array.info.unit;
  const std::string frame = name_of(array.info.frame);
  const char* const advice = array.info.access == Access::write ? ". You may overwrite it; the batch never reads it." : ".";
  entry["doc"] =
      shape_text(array.info) + unit + (frame.empty() ? "" : ", " + frame + " frame") + ": " + array.info.about + advice;
  return entry;
}

}  // namespace

void add_array(const py::object& cls, const ArrayView& listed, ViewArray view_now, GetArrays get) {
  if (listed.info.access == Access::internal) return;
  const auto property = py::reinterpret_borrow<py::object>(reinterpret_cast<PyObject*>(&PyProperty_Type));
  const auto read = [get, view_now, name = listed.name, dtype = std::make_shared<py::object>()](const py::object& self) {
    const AnyViewed viewed = get(self, name);
    const ArrayView now = view_now(viewed.arrays, viewed.items);
    if (!*dtype) *dtype = dtype_of(now);  // not before the first use, because it imports NumPy
    return view(viewed.owner, py::reinterpret_borrow<py::dtype>(*dtype), now.data, shape_of(now).span(),
                now.info.access == Access::write);
  };
  if (!cls.attr("__dict__").contains("_arrays")) cls.attr("_arrays") = py::list();
  const py::dict description = description_of(listed);
  const py::cpp_function get_view(read, py::is_method(cls));
  cls.attr(attribute_of(listed).c_str()) = property(get_view, py::none(), py::none(), description["doc"]);
  cls.attr("_arrays").attr("append")(description);
}

}  // namespace flockstep::bindings
