// Python classes for the configurations, generated from their lists of fields.
#include "flockstep/config.hpp"

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <typeinfo>
#include <vector>

#include "arguments.hpp"
#include "base/field_offsets.hpp"
#include "convert.hpp"
#include "documents.hpp"
#include "flockstep/color.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/learner.hpp"
#include "flockstep/server.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep::bindings {
namespace {

using namespace py::literals;

std::string class_name(const py::object& self) { return py::str(py::type::of(self).attr("__name__")); }

// Returns the shortest decimal number that reads as this float32. Python's own repr is the shortest for the double:
// 0.05000000074505806.
py::object shortest(float value) {
  if (!std::isfinite(value)) return py::float_(static_cast<double>(value));
  std::array<char, 32> digits;
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  return py::float_(py::str(digits.data(), static_cast<std::size_t>(end - digits.data())));
}

template <class T>
py::str shown(const T& value) {
  return py::repr(to_python(value));
}
py::str shown(float value) { return py::repr(shortest(value)); }
py::str shown(const std::optional<float>& value) { return value ? shown(*value) : py::repr(py::none()); }
template <class Floats>
py::str shown_list(const Floats& values) {
  py::list list;
  for (const float value : values) list.append(shortest(value));
  return py::repr(list);
}
py::str shown(const std::vector<float>& values) { return shown_list(values); }
template <std::size_t kSize>
py::str shown(const std::array<float, kSize>& values) {
  return shown_list(values);
}

// Conversions between Python and a field of one type. Fields that are only described are never read or written.
struct FieldType {
  std::string (*stub)();
  py::str (*show)(const void* field);  // for repr()
  py::object (*read)(void* field, const py::object& owner) = nullptr;
  void (*write)(void* field, const py::object& value, const char* name) = nullptr;  // like from_python()
};
template <class Value, bool kIsDescribedOnly>
constexpr FieldType field_type() {
  FieldType type{[] { return stub_type<Value>(); }, [](const void* field) { return shown(*static_cast<const Value*>(field)); }};
  if constexpr (!kIsDescribedOnly) {  // these take most of the compile time
    type.read = [](void* field, const py::object& owner) { return member_to_python(*static_cast<Value*>(field), owner); };
    type.write = [](void* field, const py::object& value, const char* name) {
      *static_cast<Value*>(field) = from_python<Value>(value, name);
    };
  }
  return type;
}

// A field of a configuration.
struct ConfigField {
  const char* name;
  const FieldInfo* info;
  std::ptrdiff_t offset;
  FieldType type;
};

template <class Config, bool kIsDescribedOnly = false>
std::vector<ConfigField> fields_of() {
  return list_fields<ConfigField, Config>(
      []<class Value>(const char* name, const FieldInfo* info, std::ptrdiff_t offset, std::type_identity<Value>) {
        return ConfigField{name, info, offset, field_type<Value, kIsDescribedOnly>()};
      });
}

// Describes the allowed values of a field: "(0, 360]", "[6, 200], [1.5, 100]" if elements differ, or the rule of its form.
std::string allowed_values(const FieldInfo& info) {
  if (info.form == Form::plain_name) return "letters, digits, _ and -";
  if (info.form == Form::unit_quaternion) return "a unit quaternion";
  std::string text;
  const auto add = [&](const Limits& limits) {
    const std::string range = limits.text();
    if (range.empty()) return;
    text += (text.empty() ? "" : ", ") + std::string(limits.or_zero ? "0 or " : "");
    text += range.starts_with("in ") ? range.substr(3) : range;
  };
  add(info.limits);
  for (const Limits& limits : info.each) add(limits);
  return info.form == Form::direction ? text + ", not all 0" : text;
}

// Describes the fields for stubs, docstrings and documents. `default` is an expression, or "..." for an object; `shown` is for
// readers, with only the class of an object; `doc` is the docstring.
py::list described(const std::vector<ConfigField>& fields, const void* defaults) {
  py::list all;
  for (const ConfigField& field : fields) {
    const FieldInfo& info = *field.info;
    const std::string value = py::str(field.type.show(static_cast<const char*>(defaults) + field.offset));
    const bool is_object = value.ends_with(')') && !value.starts_with('(');
    const std::string shown = is_object ? value.substr(0, value.find('(')) + "()" : value;
    const std::string range = allowed_values(info), unit = info.unit;
    const std::string values = range + (range.empty() || unit.empty() ? "" : " ") + unit;
    std::string doc = info.about;
    if (!values.empty()) doc += (range.empty() ? " Unit: " : " Values: ") + values + ".";
    py::dict one;
    one["name"] = info.alias == nullptr ? field.name : info.alias;
    one["type"] = field.type.stub();
    // CPython drops a comma before a bracket in a docstring's signature.
    const bool is_single = value.ends_with(",)");
    one["default"] = is_object ? "..." : is_single ? '[' + value.substr(1, value.size() - 3) + ']' : value;
    one["shown"] = shown;
    one["values"] = values;
    one["about"] = info.about;
    one["doc"] = doc + " Default: " + shown + ".";
    all.append(one);
  }
  return all;
}

// Returns the configuration that a Python object holds.
char* held_by(const py::object& self, const std::type_info& type) {
  py::detail::type_caster_generic caster(type);
  if (!caster.load(self, false) || caster.value == nullptr)
    throw py::type_error("expected a configuration, got a " + class_name(self));
  return static_cast<char*>(caster.value);
}

py::tuple names_of(const std::vector<ConfigField>& fields) {
  py::list names;
  for (const ConfigField& field : fields) names.append(field.name);
  return names;
}

// A class of configurations. The functions that are bound for it do not depend on its type: each one that does costs a tenth of
// a second of compile time.
struct ConfigClass {
  std::string name;
  std::vector<ConfigField> fields;
  // Returns a new configuration: one keyword per field, defaults for the others.
  void* (*make)(const ConfigClass& made, const py::kwargs& keywords);
};

void set_fields(void* config, const ConfigClass& cls, const py::kwargs& keywords) {
  for (const auto& [key, value] : keywords) {
    const auto name = key.cast<std::string>();
    const auto field = std::ranges::find_if(cls.fields, [&](const ConfigField& one) { return name == one.name; });
    if (field == cls.fields.end()) {
      const auto known = names_of(cls.fields).cast<std::vector<std::string>>();
      throw py::type_error(unexpected_keyword(cls.name + ".__init__", name, known));
    }
    field->type.write(static_cast<char*>(config) + field->offset, py::reinterpret_borrow<py::object>(value), field->name);
  }
}

template <class Config>
void* make_config(const ConfigClass& cls, const py::kwargs& keywords) {
  auto config = std::make_unique<Config>();
  set_fields(config.get(), cls, keywords);
  config->validate();
  return config.release();
}

py::dict state_of(const py::object& self) {
  py::dict state;
  for (const py::handle name : self.attr("__match_args__")) state[name] = self.attr(name);
  return state;
}

// Adds a property for each field. This is not a template, because each function bound in one costs a tenth of a second of
// compile time, and there are hundreds of fields. read_only: without setters and defaults, for results.
void add_properties(const py::object& cls, const std::type_info& type, const std::vector<ConfigField>& fields,
                    const py::list& descriptions, bool read_only = false) {
  const py::is_method method(cls);
  const auto property = py::reinterpret_borrow<py::object>(reinterpret_cast<PyObject*>(&PyProperty_Type));
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const ConfigField& field = fields[i];
    const py::cpp_function get(
        [field, &type](const py::object& self) { return field.type.read(held_by(self, type) + field.offset, self); }, method);
    const py::cpp_function set(
        [field, &type](const py::object& self, const py::object& value) {
          field.type.write(held_by(self, type) + field.offset, value, field.name);
        },
        method);
    const std::string doc = py::str(descriptions[i][read_only ? "about" : "doc"]);
    cls.attr(field.name) = property(get, read_only ? py::object(py::none()) : py::object(set), py::none(), wrapped(doc, ""));
  }
}

// Returns the fields by name, with hashes of worlds instead of the worlds, which are compared by identity.
py::dict comparable_state_of(const py::object& self) {
  py::dict state = state_of(self);
  py::dict hashes;
  for (const auto& [name, value] : state) {
    if (py::isinstance<World>(value)) hashes[name] = value.cast<const World&>().content_hash();
  }
  state.attr("update")(hashes);
  return state;
}

// Adds a keyword constructor, fields, repr, equality by value and pickling, because Gymnasium copies the keywords of an env.
void add_config(const py::object& cls, const std::type_info& type, const ConfigClass& config, const void* defaults) {
  const std::vector<ConfigField>& fields = config.fields;
  const py::list descriptions = described(fields, defaults);
  add_properties(cls, type, fields, descriptions);
  cls.attr("_fields") = descriptions;
  cls.attr("__match_args__") = names_of(fields);
  cls.attr("__hash__") = py::none();  // mutable
  const auto add = [&](const char* name, const auto& function, const auto&... extra) {
    cls.attr(name) = py::cpp_function(function, py::name(name), py::is_method(cls), extra...);
  };
  // As pybind11 binds py::init() and py::pickle().
  using py::detail::value_and_holder, py::detail::is_new_style_constructor;
  add(
      "__init__",
      [config](value_and_holder& self, const py::kwargs& keywords) { self.value_ptr() = config.make(config, keywords); },
      is_new_style_constructor());
  add("__getstate__", &state_of);
  add(
      "__setstate__",
      [config](value_and_holder& self, const py::dict& state) { self.value_ptr() = config.make(config, py::kwargs(state)); },
      is_new_style_constructor());
  add("__repr__", [fields, &type](const py::object& self) {
    py::list parts;
    for (const ConfigField& field : fields) {
      parts.append(py::str("{}={}").format(field.name, field.type.show(held_by(self, type) + field.offset)));
    }
    return py::str("{}({})").format(class_name(self), py::str(", ").attr("join")(parts));
  });
  add("__eq__", [](const py::object& self, const py::object& other) -> py::object {
    if (!py::isinstance(other, py::type::of(self))) return py::reinterpret_borrow<py::object>(Py_NotImplemented);
    return py::bool_(comparable_state_of(self).equal(comparable_state_of(other)));
  });
}

// Registers a configuration class. `doc` is left out if the class stands in core.pyi, which then has its docstring.
template <class Config>
py::class_<Config> register_fields(py::module_& module, const char* name, const char* doc = "") {
  py::class_<Config> cls(module, name, doc);
  const Config defaults;
  add_config(cls, typeid(Config), {name, fields_of<Config>(), &make_config<Config>}, &defaults);
  return cls;
}

// Registers a class whose objects only calls return.
template <class Results>
void register_results(py::module_& module, const char* name, const char* doc) {
  const py::class_<Results> cls(module, name, doc);
  const std::vector<ConfigField> fields = fields_of<Results>();
  const Results defaults;
  const py::list descriptions = described(fields, &defaults);
  add_properties(cls, typeid(Results), fields, descriptions, true);
  cls.attr("__match_args__") = names_of(fields);
  cls.attr("_results") = descriptions;
}

// Returns the class name of a configuration: "gps_receiver" becomes "GpsReceiverConfig".
std::string class_name_of(std::string_view name) {
  std::string made;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const bool starts = i == 0 || name[i - 1] == '_';
    if (name[i] != '_') made += starts ? static_cast<char>(name[i] - 'a' + 'A') : name[i];
  }
  return made + "Config";
}

// Returns the words of a task for its page.
py::dict words_of(const TaskWords& words) {
  const auto pairs = [](const std::vector<TaskPart>& parts) {
    py::list list;
    for (const TaskPart& part : parts) list.append(py::make_tuple(part.name, part.about));
    return list;
  };
  return py::dict("about"_a = words.about, "start"_a = words.start, "action"_a = words.action, "observed"_a = words.observed,
                  "observation"_a = pairs(words.observation), "reward"_a = pairs(words.reward), "end"_a = words.end,
                  "view"_a = words.view, "overlay"_a = words.overlay);
}

// Describes the fields of a change as those of the configuration that it changes.
template <class Change>
py::list described_changes(const py::object& config) {
  py::list all;
  const Change change;
  for_each_field(change, [&](const auto& field, const auto&) {
    for (const py::handle one : config.attr("_fields")) {
      if (one["name"].cast<std::string_view>() == field.name) all.append(one);
    }
  });
  return all;
}

// Describes the keywords of calls that make a batch, from the descriptions of its fields: one configuration stands for a list of
// one, and sensors may also be given by the names of the fields.
py::list described_keywords(const py::list& fields) {
  py::list keywords, others;
  py::dict keyword_by_field;
  for (const py::handle field : fields) keyword_by_field[field["name"]] = keyword_of(py::str(field["name"]));
  for (const py::handle field : fields) {
    const std::string name = py::str(field["name"]), keyword = keyword_of(name);
    if (keyword.empty()) continue;
    std::string type = py::str(field["type"]);
    if (type.starts_with("Sequence[")) type = type.substr(9, type.size() - 10) + " | " + type;
    if (type == "World | None") type = "World | DroneMesh";
    py::str about = field["about"];
    for (const auto& [from, to] : keyword_by_field) {
      about = about.attr("replace")(py::str("``{}``").format(from), py::str("``{}``").format(to));
    }
    py::dict one;
    one["name"] = keyword;
    one["type"] = type;
    one["doc"] = about;
    keywords.append(one);
    if (keyword == name) continue;
    py::dict other = one.attr("copy")();
    other["name"] = name;
    other["doc"] = "Another name of ``" + keyword + "``.";
    others.append(other);
  }
  return keywords + others;
}

}  // namespace

std::string keyword_of(const std::string& field) {
  if (field == "num_envs") return "";
  static const std::vector<std::string> lists = [] {
    std::vector<std::string> names;
    const BatchConfig fields;
    for_each_field(fields, [&]<class Value>(const auto& listed, const Value&) {
      if constexpr (SensorList<Value>) names.emplace_back(listed.name);
    });
    return names;
  }();
  return std::ranges::find(lists, field) != lists.end() ? field.substr(0, field.size() - 1) : field;
}

void set_batch_fields(BatchConfig& config, const py::kwargs& keywords, const char* callee,
                      std::initializer_list<const char*> others) {
  static const std::vector<ConfigField> fields = fields_of<BatchConfig>();
  for (const auto& [key, value] : keywords) {
    const auto name = key.cast<std::string>();
    const auto is_meant = [&](const ConfigField& field) {
      const std::string keyword = keyword_of(field.name);
      return !keyword.empty() && (name == keyword || name == field.name);
    };
    const auto field = std::ranges::find_if(fields, is_meant);
    if (field == fields.end()) {
      std::vector<std::string> known(others.begin(), others.end());
      for (const ConfigField& one : fields) known.push_back(keyword_of(one.name));
      throw py::type_error(unexpected_keyword(callee, name, known));
    }
    if (value.is_none()) continue;
    const std::string keyword = keyword_of(field->name);
    if (name != keyword && keywords.contains(keyword.c_str()) && !keywords[keyword.c_str()].is_none()) {
      throw py::type_error(keyword + ": expected None with " + name + ", another name of it");
    }
    field->type.write(reinterpret_cast<char*>(&config) + field->offset, py::reinterpret_borrow<py::object>(value),
                      keyword.c_str());
  }
}

void add_batch_fields(const py::object& cls, const std::type_info& type, std::ptrdiff_t offset) {
  std::vector<ConfigField> fields = fields_of<BatchConfig>();
  const BatchConfig defaults;
  const py::list descriptions = described(fields, &defaults);
  for (ConfigField& field : fields) field.offset += offset;
  add_properties(cls, type, fields, descriptions);
}

void register_config(py::module_& module) {
  register_fields<RangeErrors>(module, "RangeErrors");
  register_fields<LidarConfig>(module, "LidarConfig")
      .def_property_readonly("shape", [](const LidarConfig& c) { return py::make_tuple(c.rows(), c.columns()); })
      .def_static("preset", &LidarConfig::preset, py::arg("product"));
  register_fields<DepthErrors>(module, "DepthErrors");
  register_fields<ColorErrors>(module, "ColorErrors");
  register_fields<EventPixels>(module, "EventPixels");
  register_fields<CameraConfig>(module, "CameraConfig")
      .def_static("preset", &CameraConfig::preset, py::arg("product"))
      .def("stereo_pair", &CameraConfig::stereo_pair, py::arg("baseline_m"))
      .def_property_readonly("fx", [](const CameraConfig& camera) { return camera.fx(); })
      .def_property_readonly("fy", [](const CameraConfig& camera) { return camera.fy(); })
      .def_property_readonly("cx", [](const CameraConfig& c) { return 0.5 * c.width_px; })
      .def_property_readonly("cy", [](const CameraConfig& c) { return 0.5 * c.height_px; })
      .def_property_readonly("image_size_px",
                             [](const CameraConfig& c) { return py::make_tuple(c.image_width_px(), c.image_height_px()); });
  register_fields<ColorRange>(module, "ColorRange",
                              "A range of colours: a pixel matches if each channel is in [low, high]. The default matches "
                              "the green of the goal.");
  const BatchConfig batch;
  for_each_field(batch, [&]<class Value>(const auto& field, const Value&) {
    if constexpr (HasFirstArrays<Value>) {
      using Config = typename Value::value_type;
      register_fields<Config>(module, class_name_of(keyword_of(field.name)).c_str(), Config::kAbout)
          .def_static("preset", &Config::preset, py::arg("product"),
                      "Return one with the errors of a product or simulator. `ValueError` lists the names.");
    } else if constexpr (requires { Value::kAbout; }) {
      register_fields<Value>(module, class_name_of(field.name).c_str(), Value::kAbout);
    }
  });
  register_fields<BodyMotion>(module, "BodyMotion", "Moves a body. Its pose is a function of the time since the episode began.");
  register_fields<BodyConfig>(module, "BodyConfig", "A solid in each env that may move: sensors see it, and drones hit it.");
  register_fields<Light>(module, "Light");
  register_fields<ObservationConfig>(module, "ObservationConfig",
                                     "What agents remember, and when they learn what their task observes.");
  register_fields<WindConfig>(
      module, "WindConfig",
      "The wind for ``motion=\"rotors\"``: a mean, and separate gusts for each drone, constant during a flown "
      "step.");
  register_fields<ControllerConfig>(
      module, "ControllerConfig",
      "Gains, limits and lag of the flight controller, a cascade: position to velocity, velocity to acceleration,\n"
      "attitude to body rates, body rates to torques. ``flockstep.variations.controllers`` has presets.");
  register_fields<DynamicsConfig>(module, "DynamicsConfig");
  register_fields<DroneParameters>(
      module, "DroneParameters",
      "What may differ from drone to drone: differences from the airframe, and what acts on the drone. The controller and\n"
      "the meaning of actions keep the airframe's own numbers. `Variation` draws them.");
  register_fields<Variation>(module, "Variation", "How a parameter of drones is drawn. `flockstep.vary` makes a list of these.");
  module.attr("parameter_names") = py::tuple(py::cast(parameter_names()));
  register_fields<ServerConfig>(module, "ServerConfig", "How a server listens, and what clients may do.");
  register_fields<NetworkConfig>(module, "NetworkConfig", "Actor and critic: two networks on the same inputs.");
  register_fields<RolloutConfig>(module, "RolloutConfig", "The steps that are collected for one update.");
  register_fields<UpdateConfig>(module, "UpdateConfig", "One update from a rollout.");
  register_results<UpdateReport>(module, "UpdateReport", "Means over the minibatches of an update.");
  register_fields<GradientConfig>(module, "GradientConfig", "One update by the derivatives of the flight.");
  register_results<GradientReport>(module, "GradientReport", "Results of such an update.");
  register_fields<NavigationReward>(module, "NavigationReward");
  register_fields<GateDetector>(module, "GateDetector", GateDetector::kAbout);
  py::dict tasks;
  for_each_task([&]<class Config>(std::type_identity<Config>) {
    const TaskWords words = Config::words();
    auto cls = register_fields<Config>(module, class_name_of(Config::kName).c_str(), docstring_of(Config::kAbout, words).c_str());
    cls.attr("_about") = Config::kAbout;
    cls.attr("_words") = words_of(words);
    if constexpr (requires { &Config::observing; }) {
      cls.def_static(
          "observing",
          [](const std::string& name) { return Config::observing(enum_of<decltype(Config::observation)>(name, "observation")); },
          py::arg("observation"));
    }
    tasks[Config::kName] = cls;
  });
  module.attr("engine_tasks") = tasks;
  py::dict others;  // not Python classes
  const auto add = [&]<class Config>(const char* name, const Config& defaults) {
    others[name] = described(fields_of<Config, true>(), &defaults);
  };
  add("Airframe", Airframe());
  others["BatchConfig"] = described(fields_of<BatchConfig>(), &batch);
  add("CityConfig", CityConfig());
  add("ForestConfig", ForestConfig());
  add("OfficeConfig", OfficeConfig());
  add("PlaygroundConfig", PlaygroundConfig());
  add("RaceTrackConfig", RaceTrackConfig());
  add("WarehouseConfig", WarehouseConfig());
  module.attr("_other_fields") = others;
  py::dict changes;
  changes["LidarConfig"] = described_changes<LidarChange>(module.attr("LidarConfig"));
  changes["CameraConfig"] = described_changes<CameraChange>(module.attr("CameraConfig"));
  changes["Light"] = module.attr("Light").attr("_fields");
  module.attr("_changes") = changes;
  py::dict keywords;
  for (const ConfigField& field : fields_of<BatchConfig>()) {
    if (const std::string keyword = keyword_of(field.name); !keyword.empty()) keywords[py::str(keyword)] = field.name;
  }
  module.attr("batch_keywords") = keywords;
  module.attr("_arguments") = py::dict("Batch"_a = described_keywords(others["BatchConfig"]));
}

}  // namespace flockstep::bindings
