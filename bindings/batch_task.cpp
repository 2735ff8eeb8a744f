// Members of Batch that concern its task: actions, observations, episodes and random numbers.
#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "arguments.hpp"
#include "array_views.hpp"
#include "arrays.hpp"
#include "base/array_shape.hpp"
#include "base/dtype.hpp"
#include "base/require.hpp"
#include "batch.hpp"
#include "convert.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

const TaskSpec& spec_of(const Batch& batch) {
  if (batch.task() == nullptr) throw std::runtime_error("this Batch has no task: give it one (task=...)");
  return batch.spec();
}

// Returns the number of rows of actions, observations and rewards.
py::ssize_t num_rows(const Batch& batch) { return spec_of(batch).row == Row::drone ? num_drones(batch) : num_envs(batch); }

// Returns a view of an array whose type is known only at run time.
py::array typed_view(const py::object& self, const std::byte* data, DType type, const Shape& shape, bool writable = false) {
  if (type == DType::boolean) return view<bool>(self, reinterpret_cast<const bool*>(data), shape, writable);
  return with_type(type,
                   [&]<class T>(T) -> py::array { return view<T>(self, reinterpret_cast<const T*>(data), shape, writable); });
}

// Returns the observation: the array of its only field, or a dict of arrays if there are several.
auto observation_view(std::vector<Buffer> Outputs::* member, bool writable = false) {
  return [member, writable](const py::object& self) -> py::object {
    const auto& batch = self.cast<const Batch&>();
    const TaskSpec& spec = spec_of(batch);
    const std::vector<Buffer>& buffers = batch.outputs().*member;
    const auto field_view = [&](std::size_t i) {
      const Field& field = spec.observation[i];
      Shape shape{num_rows(batch)};
      shape.insert(shape.end(), field.shape.begin(), field.shape.end());
      return typed_view(self, buffers[i].bytes().data(), field.type, shape, writable);
    };
    if (buffers.size() == 1) return field_view(0);
    py::dict fields;
    for (std::size_t i = 0; i < buffers.size(); ++i) fields[py::str(spec.observation[i].name)] = field_view(i);
    return fields;
  };
}

// Collects views of the arrays of the batch's task by name.
class TaskArrays final : public ArrayVisitor {
 public:
  explicit TaskArrays(const py::object& owner) : owner_(owner), batch_(owner.cast<const Batch&>()) {}
  void bytes(std::string_view name, std::span<std::byte> bytes, std::optional<DType> type) override {
    if (!type) return;
    const auto count = static_cast<py::ssize_t>(bytes.size() / flockstep::size_of(*type));
    const py::ssize_t n = num_rows(batch_);
    // Two-dimensional if the task's rows divide the count.
    const Shape shape = count == n || count % n != 0 || count == 0 ? Shape{count} : Shape{n, count / n};
    arrays[py::str(std::string(name))] = typed_view(owner_, bytes.data(), *type, shape);
  }
  void blob(std::string_view, std::string&) override {}

  py::dict arrays;

 private:
  py::object owner_;
  const Batch& batch_;
};

py::dict task_state(const py::object& self) {
  TaskArrays arrays(self);
  const auto& batch = self.cast<const Batch&>();
  in_turn(batch, [&] { batch.visit_task(arrays); });
  return arrays.arrays;
}

void step(Batch& batch, const py::object& actions) {
  const Field& field = spec_of(batch).action;
  if (!is_floating(field.type)) {
    const auto input = integers<std::int64_t>(actions, "actions", {num_rows(batch)});
    released(batch, [&] { batch.step(std::span<const std::int64_t>(input)); });
  } else {
    Shape shape{num_rows(batch)};
    shape.insert(shape.end(), field.shape.begin(), field.shape.end());
    const Input<float> input(actions, "actions", shape, "f", "floats");
    released(batch, [&] { batch.step(std::span<const float>(input)); });
  }
}

void set_controller(Batch& batch, const py::object& controller) {
  if (controller.is_none()) return in_turn(batch, [&] { batch.set_controller({}); });
  if (PyCallable_Check(controller.ptr()) == 0) {
    throw py::type_error("controller: expected a function or None, got " + std::string(py::str(py::type::of(controller))));
  }
  const auto call = controller.cast<std::function<py::object(py::array_t<float>, int)>>();  // copies take the interpreter lock
  const auto shape_of = [n = num_drones(batch)](std::size_t columns) { return Shape{n, static_cast<py::ssize_t>(columns)}; };
  in_turn(batch, [&] {
    batch.set_controller([call, commands = shape_of(batch.command_size()), shape = shape_of(batch.num_rotors()),
                          speeds = std::vector<float>()](std::span<const float> command, int tick) mutable {
      const py::gil_scoped_acquire acquire;
      const auto given = floats(call(py::array_t<float>(commands, command.data()), tick), "controller", shape);
      const std::span<const float> numbers = given;
      speeds.assign(numbers.begin(), numbers.end());
      return std::span<const float>(speeds);
    });
  });
}

py::array_t<float> path(const Batch& batch) {
  const std::span<const float> points = batch.path();
  const auto ticks = static_cast<py::ssize_t>(batch.config().clock.substeps());
  py::array_t<float> copy({static_cast<py::ssize_t>(batch.config().num_drones()), ticks + 1, py::ssize_t{3}});
  std::ranges::copy(points, copy.mutable_data());
  return copy;
}

// Returns how the episodes of an env's drones belong together.
Episodes episodes_of(const Batch& batch) {
  return batch.config().drones_per_env == 1 || batch.task() == nullptr ? Episodes::team : batch.config().episode.episodes;
}

py::array_t<float> random(const Batch& batch, std::uint32_t stream, int count, const py::object& rows,
                          const std::string& row_kind) {
  const auto given = integers<std::int64_t>(rows, "rows", {-1});
  const bool of_drones = enum_of<Row>(row_kind, "row_kind") == Row::drone;
  if (!of_drones && episodes_of(batch) == Episodes::each && rows_of_reset(*batch.task())) {
    refuse("row_kind",
           "\"drone\" in a reset with episodes=\"each\" (the numbers of an env do not change when one of its drones begins)",
           "\"env\"");
  }
  return in_turn(batch, [&] {  // the number of envs may change until then
    std::vector<std::int64_t> all;
    if (!given.given()) {
      all.resize(static_cast<std::size_t>(of_drones ? num_drones(batch) : num_envs(batch)));
      std::iota(all.begin(), all.end(), std::int64_t{0});
    }
    const std::span<const std::int64_t> chosen = given.given() ? std::span<const std::int64_t>(given) : all;
    py::array_t<float> numbers({std::ssize(chosen), static_cast<py::ssize_t>(std::max(count, 0))});
    const std::span<float> out(numbers.mutable_data(), static_cast<std::size_t>(numbers.size()));
    if (of_drones) {
      batch.random_of_drones(stream, count, chosen, out);
    } else {
      batch.random(stream, count, chosen, out);
    }
    return numbers;
  });
}

// Returns the rows whose episodes begin, within a Python task's reset; otherwise all rows.
py::array_t<std::int64_t> beginning_rows(const Batch& batch) {
  const py::ssize_t count = num_rows(batch);
  if (const std::optional<py::array_t<std::int64_t>> rows = rows_of_reset(*batch.task())) return *rows;
  py::array_t<std::int64_t> all(count);
  std::iota(all.mutable_data(), all.mutable_data() + count, std::int64_t{0});
  return all;
}

Viewed<EpisodeState> episodes_arrays(const py::object& self, const char*) { return {self.cast<const Batch&>().episodes(), self}; }
Viewed<Outputs> outputs_arrays(const py::object& self, const char*) {
  const auto& batch = self.cast<const Batch&>();
  return {batch.outputs(), self, {.sizes = {std::ssize(spec_of(batch).reward_terms), 1}, .dimensions = 1}};
}

}  // namespace

void add_task(BatchClass& cls) {
  const auto none = py::none();
  add_arrays<EpisodeState, &episodes_arrays>(cls);
  add_arrays<Outputs, &outputs_arrays>(cls);
  cls.def("random", &random, py::arg("stream"), py::arg("count"), py::arg("rows") = none, py::arg("row_kind") = "env")
      .def_property_readonly("rows", &beginning_rows)
      .def(
          "reset",
          [](Batch& batch, const py::object& seeds, const py::object& mask) {
            const auto s = integers<std::uint64_t>(seeds, "seeds", {num_envs(batch)});
            if (seeds.is_none() && episodes_of(batch) != Episodes::team && py::hasattr(mask, "__len__") &&
                static_cast<py::ssize_t>(py::len(mask)) == num_drones(batch)) {
              const auto drones = flags(mask, "mask", num_drones(batch));
              return released(batch, [&] { batch.reset_drones(drones); });
            }
            const auto m = flags(mask, "mask", num_envs(batch));
            released(batch, [&] { batch.reset(s, m); });
          },
          py::arg("seeds") = none, py::arg("mask") = none)
      .def("step", &step, py::arg("actions"))
      .def("set_controller", &set_controller, py::arg("controller"))
      .def_property_readonly("waiting",
                             [](const Batch& batch) {
                               const FlagArray waiting = in_turn(batch, [&] { return batch.waiting(); });
                               py::array_t<bool> rows(static_cast<py::ssize_t>(waiting.size()));
                               std::ranges::copy(waiting, rows.mutable_data());
                               return rows;
                             })
      .def_property_readonly("spec", [](const Batch& batch) { return spec_of(batch); })
      .def_property_readonly("path", &path)
      .def_property_readonly("observation", observation_view(&Outputs::observation, true))
      .def_property_readonly("final_observation", observation_view(&Outputs::final_observation))
      .def_property_readonly("task_state", &task_state);
}

}  // namespace flockstep::bindings
