// Converts values of configurations and task specifications. Enumerations and camera outputs are names in Python.
#pragma once

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "base/excerpt.hpp"
#include "base/nearest_name.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/world.hpp"

namespace flockstep::bindings {

namespace py = pybind11;

using Names = std::span<const char* const>;

// Returns the index of a name in an enumeration. Throws ValueError that names the field, the expected names and the actual
// value.
inline std::size_t index_of(const std::string& text, Names names, const std::string& field) {
  std::string expected;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (text == names[i]) return i;
    expected += (i == 0 ? "\"" : i + 1 == names.size() ? " or \"" : ", \"") + std::string(names[i]) + '"';
  }
  throw py::value_error(field + ": expected " + expected + ", got \"" + text + '"' +
                        did_you_mean(text, std::vector<std::string_view>(names.begin(), names.end())));
}
template <class Enum>
Enum enum_of(const std::string& text, const std::string& field) {
  return static_cast<Enum>(index_of(text, EnumNames<Enum>::kNames, field));
}

template <class Enum>
const char* name_of(Enum value) {
  return EnumNames<Enum>::kNames[static_cast<std::size_t>(value)];
}

template <SetOfNames Outputs>
Outputs outputs_of(const py::handle& names) {
  Outputs outputs;
  for_each_field(outputs, [](const auto&, bool& chosen) { chosen = false; });
  if (py::isinstance<py::str>(names) || !py::isinstance<py::iterable>(names)) {
    const std::string got = py::repr(names);
    const std::string hint = py::isinstance<py::str>(names) ? ": write (" + got + ",)" : "";
    throw py::type_error("outputs: expected a sequence of names, got " + got + hint);
  }
  for (const py::handle name : names) {
    const auto text = py::str(name).cast<std::string>();
    std::string expected;
    std::vector<std::string_view> known;
    bool found = false;
    for_each_field(outputs, [&](const auto& field, bool& chosen) {
      expected += (expected.empty() ? "" : ", ") + std::string(field.name);
      known.push_back(field.name);
      if (text != field.name) return;
      chosen = found = true;
    });
    if (!found)
      throw py::value_error("outputs: expected names among " + expected + ", got " + quoted_excerpt(text) +
                            did_you_mean(text, known));
  }
  return outputs;
}

template <SetOfNames Outputs>
py::tuple names_of(const Outputs& outputs) {
  py::list names;
  for_each_field(outputs, [&](const auto& field, bool chosen) {
    if (chosen) names.append(field.name);
  });
  return py::tuple(names);
}

template <class T>
py::object to_python(const T& value) {
  if constexpr (std::is_enum_v<T>) {
    return py::str(name_of(value));
  } else if constexpr (SetOfNames<T>) {
    return names_of(value);
  } else {
    return py::cast(value);
  }
}

// Its default is converted before World is registered.
inline py::object to_python(const std::shared_ptr<const World>& world) {
  return world ? py::cast(std::const_pointer_cast<World>(world)) : py::object(py::none());
}

template <class Enums>
  requires std::is_enum_v<typename Enums::value_type> && requires(Enums values) { values.size(); }
py::list to_python(const Enums& values) {
  py::list names;
  for (const auto value : values) names.append(name_of(value));
  return names;
}

// Returns a configuration within another one as a part of its owner, so that its fields can be set, and a copy of other values.
template <class T>
py::object member_to_python(T& value, const py::object& owner) {
  if constexpr (HasFields<T> && !SetOfNames<T>) {
    return py::cast(value, py::return_value_policy::reference_internal, owner);
  } else {
    return to_python(value);
  }
}

template <class T>
concept OptionalValue = requires(const T& value) { value.has_value(); };
template <class T>
concept SequenceOfValues = !std::is_same_v<T, std::string> && requires(const T& values) { values[0]; };
template <class T>
concept SequenceOfConfigs = SequenceOfValues<T> && HasFields<typename T::value_type>;

// The name of a value in messages.
template <class T>
std::string python_name() {
  if constexpr (OptionalValue<T>) return python_name<typename T::value_type>() + " or None";
  if constexpr (std::is_same_v<T, std::shared_ptr<const World>>) return "a flockstep.DroneMesh, a flockstep.World or None";
  if constexpr (SequenceOfValues<T>) {
    if constexpr (requires { std::tuple_size<T>::value; }) return std::to_string(std::tuple_size_v<T>) + " numbers";
    if constexpr (std::is_same_v<typename T::value_type, std::string>) return "a sequence of strings";
    return "a sequence of numbers";
  }
  if constexpr (std::is_same_v<T, bool>) return "a bool";
  if constexpr (std::is_integral_v<T>) return "an integer";
  if constexpr (std::is_floating_point_v<T>) return "a number";
  if constexpr (std::is_same_v<T, std::string> || std::is_enum_v<T>) return "a string";
  if constexpr (HasFields<T>) return "a flockstep." + std::string(py::str(py::type::of<T>().attr("__name__")));
  return "another type";
}

inline std::string literal(Names names) {
  std::string text;
  for (const char* const name : names) text += (text.empty() ? "\"" : ", \"") + std::string(name) + '"';
  return "Literal[" + text + "]";
}

// The type's name in a stub.
template <class T>
std::string stub_type() {
  if constexpr (OptionalValue<T>) {
    return stub_type<typename T::value_type>() + " | None";
  } else if constexpr (SequenceOfValues<T>) {
    return "Sequence[" + stub_type<typename T::value_type>() + "]";
  } else if constexpr (std::is_same_v<T, std::shared_ptr<const World>>) {
    return "World | None";
  } else if constexpr (std::is_enum_v<T>) {
    return literal(EnumNames<T>::kNames);
  } else if constexpr (std::is_same_v<T, bool>) {
    return "bool";
  } else if constexpr (std::is_integral_v<T>) {
    return "int";
  } else if constexpr (std::is_floating_point_v<T>) {
    return "float";
  } else if constexpr (std::is_same_v<T, std::string>) {
    return "str";
  } else if constexpr (SetOfNames<T>) {
    return "Sequence[str]";
  } else {
    return py::str(py::type::of<T>().attr("__name__"));
  }
}

// Returns true for a bool, including NumPy's. Python accepts bools as numbers, so they need a separate check.
inline bool is_bool(const py::handle& value) { return py::detail::make_caster<bool>().load(value, false); }

// Describes the range of an integer type for messages; empty for other types.
template <class T>
std::string integer_range() {
  if constexpr (OptionalValue<T>) return integer_range<typename T::value_type>();
  if constexpr (std::is_integral_v<T> && !std::is_same_v<T, bool>) {
    return std::to_string(std::numeric_limits<T>::min()) + " to " + std::to_string(std::numeric_limits<T>::max());
  }
  return "";
}

[[noreturn]] inline void refuse_value(const py::handle& value, const std::string& field, const std::string& expected,
                                      const std::string& integers) {
  const std::string got = ", got " + std::string(py::repr(value));
  if (!integers.empty() && PyLong_Check(value.ptr()) && !is_bool(value)) {
    throw py::value_error(field + ": expected an integer from " + integers + got);
  }
  throw py::type_error(field + ": expected " + expected + got);
}

// Describes a value that is not of a class. For a dict of the fields of a configuration, shows the call that makes one.
inline std::string got_instead(const py::handle& value, const py::handle& cls, bool is_config) {
  std::string text = ", got " + std::string(py::repr(value));
  if (!is_config || !py::isinstance<py::dict>(value)) return text;
  text += ": write flockstep." + std::string(py::str(cls.attr("__name__"))) + '(';
  std::string separator;
  for (const auto& [name, item] : py::reinterpret_borrow<py::dict>(value)) {
    text += std::exchange(separator, ", ") + std::string(py::str(name)) + '=' + std::string(py::repr(item));
  }
  return text + ')';
}

template <class Configs>
Configs configs_of(const py::handle& given, const std::string& name);

// Returns the world of a flockstep.DroneMesh, and other values unchanged.
inline py::object mesh_world(const py::handle& value) {
  const bool is_mesh = !value.is_none() && !py::isinstance<World>(value) &&
                       py::isinstance(value, py::module_::import("flockstep.drone_mesh").attr("DroneMesh"));
  return is_mesh ? value.attr("world")() : py::reinterpret_borrow<py::object>(value);
}

// Converts a Python value. Throws TypeError or ValueError that names the field.
template <class T>
T from_python(const py::handle& given, const std::string& field) {
  py::handle value = given;
  py::object world;
  if constexpr (std::is_same_v<T, std::shared_ptr<const World>>) value = world = mesh_world(given);
  if constexpr (SetOfNames<T>) {
    return outputs_of<T>(value);
  } else if constexpr (SequenceOfConfigs<T>) {
    return configs_of<T>(value, field);
  } else if constexpr (std::is_enum_v<T>) {
    return enum_of<T>(from_python<std::string>(value, field), field);
  } else {
    if constexpr (SequenceOfValues<T>) refuse_masked(value, field);
    if constexpr (std::is_same_v<T, std::vector<std::string>>) {
      if (py::isinstance<py::str>(value)) return {value.cast<std::string>()};
    }
    try {
      if constexpr (std::is_same_v<T, bool>) {  // cast() would accept any object's truth value
        py::detail::make_caster<bool> flag;
        if (!flag.load(value, false)) throw py::cast_error();
        return flag;
      } else {
        T converted = value.cast<T>();
        bool has_bool = is_bool(value);
        if constexpr (SequenceOfValues<T>) {
          for (const py::handle item : value) has_bool |= is_bool(item);
        }
        if (has_bool) throw py::cast_error();
        return converted;
      }
    } catch (const py::cast_error&) {
      if constexpr (HasFields<T>) {
        throw py::type_error(field + ": expected " + python_name<T>() + got_instead(value, py::type::of<T>(), true));
      }
      refuse_value(value, field, python_name<T>(), integer_range<T>());
    }
  }
}

// Returns an argument that must be an instance of T. Throws TypeError that names the argument.
template <class T>
T& argument(const py::handle& value, const std::string& name, const std::string& expected) {
  if (!py::isinstance<T>(value)) {
    throw py::type_error(name + ": expected " + expected + got_instead(value, py::type::of<T>(), HasFields<T>));
  }
  return value.cast<T&>();
}

inline std::string type_name(const py::handle& value) { return py::str(py::type::of(value).attr("__name__")); }

// Returns the place of a non-finite number in nested dicts and lists, such as "data['drag'][0]"; empty if there is none. JSON
// cannot represent such numbers.
inline std::string not_finite(const py::handle& value, const std::string& name, int levels = 32) {
  if (levels == 0) return "";  // a dict may contain itself
  if (py::isinstance<py::float_>(value)) return std::isfinite(value.cast<double>()) ? "" : name;
  std::string found;
  if (py::isinstance<py::dict>(value)) {
    for (const auto& [key, item] : py::reinterpret_borrow<py::dict>(value)) {
      if (found.empty()) found = not_finite(item, name + "[" + std::string(py::repr(key)) + "]", levels - 1);
    }
  } else if (py::isinstance<py::list>(value) || py::isinstance<py::tuple>(value)) {
    std::size_t index = 0;
    for (const py::handle item : value) {
      if (found.empty()) found = not_finite(item, name + "[" + std::to_string(index++) + "]", levels - 1);
    }
  }
  return found;
}

// Returns a dict as JSON. Throws ValueError for values that JSON cannot represent, such as NaN.
inline std::string json_text(const py::handle& data, const std::string& name) {
  try {
    const auto of_array = py::cpp_function([](const py::object& value) {  // NumPy's arrays and numbers
      if (!py::hasattr(value, "tolist")) throw py::type_error("JSON cannot represent a " + type_name(value));
      return value.attr("tolist")();
    });
    return py::str(py::module_::import("json").attr("dumps")(data, py::arg("allow_nan") = false, py::arg("default") = of_array));
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_ValueError)) throw;
    const std::string where = not_finite(data, name);
    if (where.empty()) throw;
    throw py::value_error(where + ": expected a finite number");
  }
}

// Returns Python's message for an unknown keyword, with the most similar known one.
inline std::string unexpected_keyword(const std::string& callee, const std::string& keyword,
                                      const std::vector<std::string>& known) {
  const std::vector<std::string_view> names(known.begin(), known.end());
  const std::string_view nearest = nearest_name(keyword, names);
  std::string text = callee + "() got an unexpected keyword argument '" + keyword + "'";
  if (!nearest.empty()) text += ". Did you mean '" + std::string(nearest) + "'?";
  return text;
}

inline void refuse_unknown(const std::string& callee, const py::kwargs& keywords, const std::vector<std::string>& known) {
  for (const auto& [name, value] : keywords) {
    const std::string text = py::str(name);
    if (std::ranges::find(known, text) == known.end()) throw py::type_error(unexpected_keyword(callee, text, known));
  }
}

// Returns the fields of a change that a call gives as keywords; None changes nothing.
template <class Change>
Change change_of(const pybind11::kwargs& keywords, const std::string& callee) {
  Change change;
  std::vector<std::string> known;
  for_each_field(change, [&]<class Value>(const auto& field, Value& value) {
    known.emplace_back(field.name);
    if (keywords.contains(field.name)) value = from_python<Value>(keywords[field.name], field.name);
  });
  refuse_unknown(callee, keywords, known);
  return change;
}

// Lets the error for a missing attribute of a class suggest the most similar one, or the present name of a renamed one.
inline void suggest_attributes(const py::object& cls) {
  const auto missing = [](const py::handle& self, const std::string& name) -> py::object {
    const auto builtins = py::module_::import("builtins");
    const auto known = builtins.attr("dir")(py::type::of(self)).cast<std::vector<std::string>>();
    if (std::find(known.begin(), known.end(), name) != known.end()) {  // a property, which says why it has no value
      return builtins.attr("object").attr("__getattribute__")(self, name);
    }
    throw py::attribute_error(py::str(py::type::of(self).attr("__name__")).cast<std::string>() + " has no attribute '" + name +
                              "'" + did_you_mean(name, std::vector<std::string_view>(known.begin(), known.end())));
  };
  cls.attr("__getattr__") = py::cpp_function(missing, py::is_method(cls), py::name("__getattr__"));
}

// Calls take for each object of a class in a configuration, a sequence of them or None.
inline void for_each_config(const py::handle& given, const std::string& name, const py::handle& cls,
                            const std::function<void(const py::handle&)>& take) {
  if (given.is_none()) return;
  if (py::isinstance(given, cls)) return take(given);
  const std::string type = "flockstep." + std::string(py::str(cls.attr("__name__")));
  const auto refuse = [&](const py::handle& value) {
    throw py::type_error(name + ": expected a " + type + ", None or a sequence of " + type + " objects" +
                         got_instead(value, cls, true));
  };
  if (!py::isinstance<py::sequence>(given) || py::isinstance<py::str>(given)) refuse(given);
  for (const py::handle config : given) {
    if (!py::isinstance(config, cls)) refuse(config);
    take(config);
  }
}
template <class Configs>
Configs configs_of(const py::handle& given, const std::string& name) {
  using Config = typename Configs::value_type;
  Configs configs;
  for_each_config(given, name, py::type::of<Config>(),
                  [&](const py::handle& config) { configs.push_back(config.cast<const Config&>()); });
  return configs;
}

}  // namespace flockstep::bindings
