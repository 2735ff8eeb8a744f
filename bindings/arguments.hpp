// Converts arguments that several files take: worlds, drones, tasks and the fields of a batch.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <typeinfo>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/task.hpp"
#include "flockstep/tasks.hpp"
#include "flockstep/world.hpp"

namespace flockstep::bindings {

// Returns the worlds that flockstep.scenes.load() gives for an argument called `worlds`.
std::vector<std::shared_ptr<World>> worlds_argument(const pybind11::object& worlds);
// Returns a single world. Throws ValueError if the argument stands for several.
std::shared_ptr<World> world_argument(const pybind11::object& world);
// Returns the keywords that are not None. Throws TypeError for one that is not a field of Light.
pybind11::kwargs light_changes(const pybind11::kwargs& keywords, const char* callee);
// Returns the lighting of a world with some changes; tint: None, one colour for all materials, or one per material.
Lighting lighting_argument(const World& world, const pybind11::kwargs& changes, const pybind11::object& tint);
// Returns a drone model from a model or an argument of DroneModel.load(); None means DroneModel::quadrotor650().
DroneModel drone_argument(const pybind11::object& drone);

// Returns the configuration of an engine task; nothing for other objects.
std::optional<TaskConfig> engine_task(const pybind11::object& description);

// Returns the path of the library of a NativeTask; nothing for other objects.
std::optional<std::string> library_of(const pybind11::object& description);

// Names the configuration classes of the engine's tasks, for messages.
std::string names_of_task_configs();

// Creates a task from an engine task's configuration, a NativeTask or a PythonTask; null for None.
std::unique_ptr<Task> make_task(const pybind11::object& description);

// Returns the rows whose episodes a task's reset is beginning, within the reset of a task written in Python.
std::optional<pybind11::array_t<std::int64_t>> rows_of_reset(const Task& task);

// Adds a property for each field of a BatchConfig that is embedded in the C++ object of a class, `offset` bytes from its
// beginning.
void add_batch_fields(const pybind11::object& cls, const std::type_info& type, std::ptrdiff_t offset);

// A list of sensors of one kind, as BatchConfig has them.
template <class Value>
concept SensorList = requires(const Value& list) { list.front().rate_hz; };
// The same if the first one has its arrays as attributes of the batch. The LiDARs and cameras have classes of their own.
template <class Value>
concept HasFirstArrays = SensorList<Value> && requires { typename Value::value_type::Readings; };

// The keyword of a field of BatchConfig: lists of sensors have a short one, because mostly there is one of each. Empty for the
// number of envs, which every call that makes a batch takes in a form of its own.
std::string keyword_of(const std::string& field);

// Sets the fields of a batch that a call gives as keywords; None changes nothing. Throws TypeError that names `callee`
// for a keyword that is neither such a field nor among the `others` that the call has.
void set_batch_fields(BatchConfig& config, const pybind11::kwargs& keywords, const char* callee,
                      std::initializer_list<const char*> others);

}  // namespace flockstep::bindings
