// Batch.bodies: the bodies of all envs.
#include <pybind11/stl.h>

#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "array_views.hpp"
#include "arrays.hpp"
#include "batch.hpp"
#include "convert.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

// Bodies of a batch. Keeps the batch alive, because its arrays are views.
struct BodiesView {
  py::object owner;

  Batch& batch() const { return owner.cast<Batch&>(); }
  py::ssize_t per_env() const { return static_cast<py::ssize_t>(batch().bodies().per_env()); }
  Shape rows(py::ssize_t columns) const { return {num_envs(batch()), per_env(), columns}; }
};

std::string describe_bodies(const BodiesView& view) {
  const FlagArray& active = view.batch().state().bodies.active;
  return "<Bodies: " + std::to_string(std::ranges::count(active, 1)) + " in " + counted(num_envs(view.batch()), "env") + " of " +
         counted(view.per_env(), "slot") + '>';
}

// Returns a mask of bodies (E, B) as flags. Accepts a mask of envs (E,), which selects all of their bodies.
std::vector<std::uint8_t> body_mask(const BodiesView& view, const py::object& mask) {
  const auto envs = static_cast<std::size_t>(num_envs(view.batch())), per_env = static_cast<std::size_t>(view.per_env());
  if (mask.is_none()) return {};
  if (py::len(mask) > 0 && py::array(mask).ndim() == 1) {
    const auto given = flags(mask, "mask", num_envs(view.batch()));
    const std::span<const std::uint8_t> of_envs = given;
    std::vector<std::uint8_t> all(envs * per_env);
    for (std::size_t row = 0; row < all.size(); ++row) all[row] = of_envs[row / per_env];
    return all;
  }
  const Input<std::uint8_t> given(mask, "mask", {num_envs(view.batch()), view.per_env()}, "b", "bool");
  const std::span<const std::uint8_t> all = given;
  return {all.begin(), all.end()};
}

Viewed<BodyState> bodies_arrays(const py::object& self, const char*) {
  const auto& view = self.cast<const BodiesView&>();
  return {view.batch().state().bodies, memory_of(view.owner), {.bodies = {num_envs(view.batch()), view.per_env()}}};
}

}  // namespace

void add_bodies(py::module_& module, BatchClass& cls) {
  const auto none = py::none();
  py::class_<BodiesView> bodies(module, "Bodies", "The bodies of a batch: E envs of B slots.");
  add_arrays<BodyState, &bodies_arrays>(bodies);
  bodies.def("__repr__", &describe_bodies)
      .def("__len__", &BodiesView::per_env)
      .def(
          "spawn",
          [](const BodiesView& view, const py::object& config, const py::object& position, const py::object& quat_wxyz,
             const py::object& velocity, const py::object& angular_velocity, const py::object& mask) {
            Batch& batch = view.batch();
            const auto body = argument<BodyConfig>(config, "body", "a flockstep.BodyConfig");
            const py::ssize_t n = num_envs(batch);
            const auto p = floats(position, "position", {n, 3});
            const auto q = floats(quat_wxyz, "quat_wxyz", {n, 4});
            const auto v = floats(velocity, "velocity", {n, 3});
            const auto w = floats(angular_velocity, "angular_velocity", {n, 3});
            const auto m = flags(mask, "mask", n);
            return array_of(in_turn(batch, [&] { return batch.bodies().spawn(body, p, q, v, w, m); }));
          },
          py::arg("body"), py::arg("position") = none, py::arg("quat_wxyz") = none, py::arg("velocity") = none,
          py::arg("angular_velocity") = none, py::arg("mask") = none)
      .def(
          "remove",
          [](const BodiesView& view, const py::object& mask) {
            const std::vector<std::uint8_t> m = body_mask(view, mask);
            in_turn(view.batch(), [&] { view.batch().bodies().remove(m); });
          },
          py::arg("mask") = none)
      .def(
          "config",
          [](const BodiesView& view, const py::object& env, const py::object& body) -> std::optional<BodyConfig> {
            const auto at = [](const py::object& number, const char* name, std::int64_t end) {
              const auto index = from_python<std::int64_t>(number, name);
              require(index >= 0 && index < end, name, "an integer in [0, " + std::to_string(end) + ")", index);
              return static_cast<std::size_t>(index);
            };
            const EnvIndex e(at(env, "env", num_envs(view.batch())));
            const BodyConfig* const found = view.batch().bodies().config(e, at(body, "body", view.per_env()));
            return found == nullptr ? std::nullopt : std::optional(*found);
          },
          py::arg("env"), py::arg("body"));
  const auto add = [&](const char* name, const char* linear, const char* turn, py::ssize_t turn_columns, auto set) {
    bodies.def(
        name,
        [=](const BodiesView& view, const py::object& first, const py::object& second, const py::object& mask) {
          const auto a = floats(first, linear, view.rows(3)), b = floats(second, turn, view.rows(turn_columns));
          const std::vector<std::uint8_t> m = body_mask(view, mask);
          in_turn(view.batch(), [&] { (view.batch().bodies().*set)(a, b, m); });
        },
        py::arg(linear) = py::none(), py::arg(turn) = py::none(), py::arg("mask") = py::none());
  };
  add("set_pose", "position", "quat_wxyz", 4, &Batch::Bodies::set_pose);
  add("set_velocity", "velocity", "angular_velocity", 3, &Batch::Bodies::set_velocity);
  cls.def_property_readonly("bodies", [](const py::object& self) { return BodiesView{self}; });
}

}  // namespace flockstep::bindings
