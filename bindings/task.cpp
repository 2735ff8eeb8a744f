// Task specifications, tasks written in Python, and tasks from shared libraries.
#include <pybind11/functional.h>
#include <pybind11/native_enum.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <optional>
#include <sstream>
#include <utility>

#include "arguments.hpp"
#include "arrays.hpp"
#include "base/finite.hpp"
#include "base/platform.hpp"
#include "base/require.hpp"
#include "batch/bad_states.hpp"
#include "batch/checks.hpp"
#include "convert.hpp"
#include "flockstep/recipe.hpp"
#include "flockstep/tasks.hpp"
#include "planning/navigable.hpp"

namespace flockstep {

namespace bindings {
namespace {

// A task of a shared library that uses FLOCKSTEP_EXPORT_TASK.
struct NativeTask {
  std::string path;
  Task* (*make)();
};

NativeTask load_task(const py::object& given) {
  if (!py::isinstance<py::str>(given) && !py::hasattr(given, "__fspath__"))
    throw py::type_error("path: expected the path of a shared library (a str or a Path), got " + std::string(py::repr(given)));
  const auto path = py::module_::import("os").attr("fsdecode")(given).cast<std::string>();
  const std::optional<std::string> version = exported_text(path, "flockstep_task_version");
  require(version.has_value(), "path", "a shared library with a task, which ends with FLOCKSTEP_EXPORT_TASK(YourTask)",
          '\'' + path + "', which exports no flockstep_task_version");
  require(*version == FLOCKSTEP_TASK_VERSION, "path",
          "a library built for " FLOCKSTEP_TASK_VERSION " (build it again with the headers in flockstep.include_dir())",
          '\'' + path + "', built for " + *version);
  return {path, reinterpret_cast<Task* (*)()>(load_function(path, "flockstep_make_task"))};
}

// A task implemented in Python. Its methods take and return arrays with the rows of spec().row. The Python method names are
// those of flockstep.task.TaskCalls.
class PythonTask final : public Task {
 public:
  PythonTask(TaskSpec spec, std::string identity, int max_episode_steps, py::object calls)
      : spec_(std::move(spec)),
        identity_(std::move(identity)),
        max_episode_steps_(max_episode_steps),
        calls_(new py::object(std::move(calls)), [](py::object* object) {
          const py::gil_scoped_acquire acquire;
          std::default_delete<py::object>()(object);
        }) {}

  const TaskSpec& spec() const override { return spec_; }
  TaskDefaults defaults() const override { return {.max_episode_steps = max_episode_steps_}; }
  std::string identity() const override { return identity_; }
  bool takes(Control) const override { return true; }  // act() must return setpoints for this control
  bool takes_all_envs_at_once() const override { return true; }

  void setup(const TaskContext& context) override {
    is_per_drone_ = spec_.row == Row::drone;
    num_rows_ = is_per_drone_ ? context.num_drones() : context.num_envs();
  }
  void place(const TaskBlock&) override {}  // Task.reset places and begins

  void begin(const TaskBlock& block) override {
    const py::gil_scoped_acquire acquire;
    {
      const Beginning beginning(*this, is_per_drone_ ? indices(block.drones) : indices(block.envs));
      calls_->attr("begin")(*beginning_);
    }
    for (const DroneIndex drone : block.drones) {
      const Vec3 position = position_of(block.context.state(), drone);
      const World& world = block.context.world_of(block.context.env_of(drone));
      const Aabb space = open_space(world);
      if ((position.array() >= space.min.array()).all() && (position.array() <= space.max.array()).all()) continue;
      std::ostringstream expected, got;
      expected << "drones within the room of world \"" << world.name() << "\", (" << space.min.transpose() << ") to ("
               << space.max.transpose() << ')';
      got << '(' << position.transpose() << ") of drone " << drone << " after reset()";
      refuse("reset: position", expected.str(), got.str());
    }
  }

  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    const py::gil_scoped_acquire acquire;
    const auto n = static_cast<py::ssize_t>(block.context.num_drones());
    const py::tuple targets = calls_->attr("command")(copy_of(actions));
    require(!targets[0].is_none(), "act", "an array of positions or commands", "None");
    if (block.context.dynamics().control != Control::pose) {
      require(targets[1].is_none(), "act", "commands (N, 4) of the control", "a pair of positions and quaternions");
      const std::size_t size = block.context.command_size();
      const auto commands = floats(targets[0], "act: command", {n, static_cast<py::ssize_t>(size)});
      const std::span<const float> rows = commands;
      const std::optional<std::size_t> far = checks::angles(block.context.dynamics().control, rows, "act: command");
      if (far && !std::exchange(has_far_yaw_, true)) {
        const std::string warning = checks::far_yaw("act: command", rows, *far);
        if (PyErr_WarnEx(PyExc_RuntimeWarning, warning.c_str(), 1) != 0) throw py::error_already_set();
      }
      for (const DroneIndex drone : block.drones) {
        std::copy_n(rows.data() + size * drone, size, setpoints.command.data() + size * drone);
      }
      return;
    }
    const auto position = floats(targets[0], "act: target position", {n, 3});
    const auto quat_wxyz = floats(targets[1], "act: target quat_wxyz", {n, 4});
    const std::span<const float> p = position, q = quat_wxyz;
    const State& state = block.context.state();
    bool bad = false;
    for (const DroneIndex drone : block.drones) {
      setpoints.target[drone] = {Vec3(p[3 * drone], p[3 * drone + 1], p[3 * drone + 2]), Quat::Identity()};
      const float* const wxyz = (q.empty() ? std::span<const float>(state.quat_wxyz) : q).data() + 4 * drone;
      Quat& rotation = setpoints.target[drone].rotation = Quat(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
      const float norm = rotation.norm();  // not finite: the batch handles this as a bad state
      if (std::isfinite(norm) && std::abs(norm - 1.0F) > 1e-2F) {
        throw py::value_error("act: expected unit quaternions, got one of norm " + std::to_string(norm) + " in row " +
                              std::to_string(drone));
      }
      if (!q.empty()) rotation.normalize();
      if (!is_valid(setpoints.target[drone]) && !std::exchange(bad, true)) {
        report("act: target", drone, worst_of(setpoints.target[drone]));
      }
    }
  }

  void score(const TaskBlock& block, Score& score) override {
    const py::gil_scoped_acquire acquire;
    const auto n = static_cast<py::ssize_t>(num_rows_);
    const auto terms = static_cast<py::ssize_t>(score.num_terms);
    const py::tuple scored = calls_->attr("score")();
    const auto reward = py::array_t<double, py::array::c_style | py::array::forcecast>(scored[0]);
    if (reward.ndim() != 2 || reward.shape(0) != terms || reward.shape(1) != n)
      throw py::value_error("reward: expected shape (" + std::to_string(terms) + ", " + std::to_string(n) + ")");
    const auto terminated = flags(scored[1], "terminated", n);
    const auto truncated = flags(scored[2], "truncated", n);
    const auto success = flags(scored[3], "success", n);
    const auto left_area = flags(scored[4], "left_area", n);
    const double* const columns = reward.data();
    const std::span<const std::uint8_t> ends = terminated, cuts = truncated, successes = success, left = left_area;
    bool reported = false;
    for_each_row(block, [&](std::size_t row) {
      const std::span<double> earned = score.terms_of(row);
      for (std::size_t k = 0; k < earned.size(); ++k) earned[k] = columns[k * num_rows_ + row];
      score.terminated[row] = ends[row];
      score.truncated[row] = cuts[row];
      score.success[row] = successes[row];
      score.left_area[row] = left[row];
      const auto bad = std::ranges::find_if_not(earned, is_reward);
      if (bad == earned.end() || std::exchange(reported, true)) return;
      report("step: reward term '" + spec_.reward_terms[static_cast<std::size_t>(bad - earned.begin())] + "'", row, *bad);
    });
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    const py::gil_scoped_acquire acquire;
    const py::tuple fields = calls_->attr("observe")();  // contiguous, of the field's type
    for (std::size_t i = 0; i < observation.size(); ++i) {
      const py::array field = fields[i];
      const auto* const bytes = static_cast<const std::byte*>(field.data());
      const std::size_t row = observation[i].row_bytes();
      for_each_row(block, [&](std::size_t at) { std::memcpy(observation[i].row_as_bytes(at).data(), bytes + at * row, row); });
      if (observation[i].type() == DType::float32) report_bad<float>(block, spec_.observation[i], observation[i]);
      if (observation[i].type() == DType::float64) report_bad<double>(block, spec_.observation[i], observation[i]);
    }
  }

  void visit(ArrayVisitor& visitor) override {
    {
      const py::gil_scoped_acquire acquire;
      state_ = calls_->attr("state")().cast<std::string>();
    }
    visitor.blob("state", state_);
  }

  // The rows that begin() is beginning.
  const std::optional<py::array_t<std::int64_t>>& beginning() const { return beginning_; }

  void restored() override {
    const py::gil_scoped_acquire acquire;
    calls_->attr("load")(py::bytes(state_));
    state_.clear();
  }

 private:
  // Sets the rows of a reset for its scope.
  class Beginning {
   public:
    Beginning(PythonTask& task, py::array_t<std::int64_t> rows) : task_(task) {
      rows.attr("setflags")(py::arg("write") = false);  // batch.rows returns this array
      task_.beginning_ = std::move(rows);
    }
    ~Beginning() { task_.beginning_.reset(); }
    Beginning(const Beginning&) = delete;
    Beginning& operator=(const Beginning&) = delete;

   private:
    PythonTask& task_;
  };

  // The batch ends the episode of a row with such a value and continues. This reports the row to the author of the task.
  void report(const std::string& what, std::size_t row, double value) const { calls_->attr("report")(what, row, value); }

  // Calls f(row) for each row of the block.
  template <class F>
  void for_each_row(const TaskBlock& block, const F& f) const {
    if (is_per_drone_) {
      for (const DroneIndex drone : block.drones) f(std::size_t{drone});
    } else {
      for (const EnvIndex env : block.envs) f(std::size_t{env});
    }
  }

  // Returns the number that makes a pose invalid.
  static double worst_of(const Pose& pose) {
    for (const float x : pose.position) {
      if (!is_in_world(x)) return x;
    }
    return pose.rotation.norm();
  }

  template <class T>
  void report_bad(const TaskBlock& block, const Field& field, const Buffer& values) const {
    bool reported = false;
    for_each_row(block, [&](std::size_t at) {
      const std::span<const T> row = values.row<T>(at);
      if (reported || are_finite(row)) return;
      for (std::size_t i = 0; i < row.size() && !reported; ++i) {
        if (!is_bad(field, i, row[i])) continue;
        reported = true;
        report("observe: '" + field.name + "'", at, row[i]);
      }
    });
  }

  template <class Kind>
  static py::array_t<std::int64_t> indices(std::span<const Index<Kind>> from) {
    py::array_t<std::int64_t> array(static_cast<py::ssize_t>(from.size()));
    std::ranges::transform(from, array.mutable_data(), [](std::size_t index) { return static_cast<std::int64_t>(index); });
    return array;
  }

  py::array copy_of(const Buffer& actions) const {
    Shape shape{static_cast<py::ssize_t>(num_rows_)};
    shape.insert(shape.end(), spec_.action.shape.begin(), spec_.action.shape.end());
    py::array array(py::dtype(name_of(spec_.action.type)), shape);
    std::memcpy(array.mutable_data(), actions.bytes().data(), actions.bytes().size());
    return array;
  }

  TaskSpec spec_;
  std::string identity_;
  int max_episode_steps_;
  std::shared_ptr<py::object> calls_;
  std::string state_;                                   // from the last snapshot
  std::optional<py::array_t<std::int64_t>> beginning_;  // the rows of the current reset
  bool is_per_drone_ = true;
  bool has_far_yaw_ = false;  // act() has been warned of one
  std::size_t num_rows_ = 0;
};

// Creates PythonTasks; each batch has its own task.
struct PythonTaskMaker {
  TaskSpec spec;
  std::string identity;
  int max_episode_steps;
  py::object calls;
};

py::object bounds(const std::vector<double>& values) {
  if (values.size() == 1) return py::float_(values[0]);
  return py::array_t<double>(static_cast<py::ssize_t>(values.size()), values.data());
}

Field make_field(const std::string& name, const std::string& dtype, std::vector<std::int64_t> shape, double low, double high) {
  return {.name = name, .type = enum_of<DType>(dtype, "dtype"), .shape = std::move(shape), .low = {low}, .high = {high}};
}

// Describes the bounds of a field: one number if all are equal, otherwise the least and the greatest.
std::string describe_bounds(const std::vector<double>& values) {
  const auto [least, greatest] = std::ranges::minmax(values);
  const std::string low = py::repr(py::float_(least));
  return least == greatest ? low : low + " to " + std::string(py::repr(py::float_(greatest)));
}

std::string describe_field(const Field& field) {
  return "<Field '" + field.name + "': " + name_of(field.type) + ' ' + std::string(py::repr(py::tuple(py::cast(field.shape)))) +
         ", low " + describe_bounds(field.low) + ", high " + describe_bounds(field.high) + '>';
}

py::str describe_spec(const TaskSpec& spec) {
  return py::str("TaskSpec(action={!r}, observation={!r}, reward_terms={!r})")
      .format(py::cast(spec.action), py::cast(spec.observation), py::cast(spec.reward_terms));
}

int time_limit(const py::object& description) {
  if (description.is_none()) throw py::type_error("task: expected a configuration of a task or a NativeTask, got None");
  return make_task(description)->defaults().max_episode_steps;
}

}  // namespace

std::optional<TaskConfig> engine_task(const py::object& description) {
  std::optional<TaskConfig> task;
  for_each_task([&]<class Config>(std::type_identity<Config>) {
    if (py::isinstance<Config>(description)) task = description.cast<Config>();
  });
  return task;
}

std::optional<std::string> library_of(const py::object& description) {
  return py::isinstance<NativeTask>(description) ? std::optional(description.cast<const NativeTask&>().path) : std::nullopt;
}

std::string names_of_task_configs() {
  std::string names;
  for_each_task([&]<class Config>(std::type_identity<Config>) {
    names += (names.empty() ? "one of " : ", ") + py::type::of<Config>().attr("__name__").template cast<std::string>();
  });
  return names;
}

std::unique_ptr<Task> make_task(const py::object& description) {
  if (description.is_none()) return nullptr;
  if (const std::optional<TaskConfig> config = engine_task(description)) return make_task(*config);
  if (py::isinstance<NativeTask>(description)) {
    const auto& library = description.cast<const NativeTask&>();
    std::unique_ptr<Task> task(library.make());
    if (!task) throw py::value_error(library.path + ": flockstep_make_task() returned no task");
    return task;
  }
  if (py::isinstance<PythonTaskMaker>(description)) {
    const auto& maker = description.cast<const PythonTaskMaker&>();
    return std::make_unique<PythonTask>(maker.spec, maker.identity, maker.max_episode_steps, maker.calls);
  }
  throw py::type_error("task: expected " + names_of_task_configs() + ", a NativeTask or None, got " +
                       std::string(py::repr(description)));
}

std::optional<py::array_t<std::int64_t>> rows_of_reset(const Task& task) {
  const auto* const python = dynamic_cast<const PythonTask*>(&task);
  return python == nullptr ? std::nullopt : python->beginning();
}

void register_task(py::module_& module) {
  module.def(
      "formation_places",
      [](const std::string& shape, int count, float spacing_m) {
        const auto kind = enum_of<FormationShape>(shape, "shape");
        require(count >= 0, "count", "an integer >= 0", count);
        require(spacing_m > 0.0F && std::isfinite(spacing_m), "spacing_m", "a finite number > 0", spacing_m);
        return rows(formation_places(kind, static_cast<std::size_t>(count), spacing_m));
      },
      py::arg("shape"), py::arg("count"), py::arg("spacing_m") = 1.5F);
  py::class_<Field>(module, "Field", "A named array that a task declares; its shape is that of one env.")
      .def(py::init(&make_field), py::arg("name"), py::arg("dtype"), py::arg("shape"), py::arg("low"), py::arg("high"))
      .def_readonly("name", &Field::name)
      .def_property_readonly("dtype", [](const Field& field) { return name_of(field.type); })
      .def_property_readonly("shape", [](const Field& field) { return py::tuple(py::cast(field.shape)); })
      .def_property_readonly("low", [](const Field& field) { return bounds(field.low); })
      .def_property_readonly("high", [](const Field& field) { return bounds(field.high); })
      .def("__repr__", &describe_field);
  py::class_<TaskSpec>(module, "TaskSpec", "Actions, observations and reward terms of a task.")
      .def(py::init([](Field action, std::vector<Field> observation, std::vector<std::string> reward_terms,
                       const std::string& row, bool records_path) {
             return TaskSpec{std::move(action), std::move(observation), std::move(reward_terms), enum_of<Row>(row, "row"),
                             records_path};
           }),
           py::arg("action"), py::arg("observation"), py::arg("reward_terms"), py::arg("row") = "drone",
           py::arg("records_path") = false)
      .def_property_readonly("row", [](const TaskSpec& spec) { return name_of(spec.row); })
      .def_readonly("records_path", &TaskSpec::records_path)
      .def_readonly("action", &TaskSpec::action)
      .def_readonly("observation", &TaskSpec::observation)
      .def_readonly("reward_terms", &TaskSpec::reward_terms)
      .def("__repr__", &describe_spec);
  py::class_<NativeTask>(module, "NativeTask", "A task of your own in C++, from a shared library.")
      .def(py::init(&load_task), py::arg("path"))
      .def_readonly("path", &NativeTask::path)
      .def("__repr__", [](const NativeTask& task) { return "NativeTask('" + task.path + "')"; })
      .def(py::pickle([](const NativeTask& task) { return py::str(task.path); },
                      [](const py::str& path) { return load_task(path); }));
  py::class_<PythonTaskMaker>(module, "PythonTask", "A task with methods in Python; made by flockstep.Task.")
      .def(py::init<TaskSpec, std::string, int, py::object>(), py::arg("spec"), py::arg("identity"), py::arg("max_episode_steps"),
           py::arg("calls"));
  py::native_enum<EpisodeEnd> ends(module, "EpisodeEnd", "enum.IntEnum");
  for (std::size_t i = 0; i < EnumNames<EpisodeEnd>::kNames.size(); ++i) {
    ends.value(EnumNames<EpisodeEnd>::kNames[i], static_cast<EpisodeEnd>(i));
  }
  ends.finalize();
  module.def("time_limit", &time_limit, py::arg("task"));
}

}  // namespace bindings
}  // namespace flockstep
