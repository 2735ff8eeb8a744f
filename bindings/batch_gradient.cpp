// Members of Batch that concern the derivatives of its flight.
#include <cstddef>
#include <span>

#include "arrays.hpp"
#include "batch.hpp"
#include "released.hpp"

namespace flockstep::bindings {

void add_gradient(BatchClass& cls) {
  const auto n_by = [](const Batch& batch, std::size_t columns) {
    return Shape{num_drones(batch), static_cast<py::ssize_t>(columns)};
  };
  const auto all_of = [](py::array_t<float>& array) {
    return std::span(array.mutable_data(), static_cast<std::size_t>(array.size()));
  };
  cls.def_property(
         "flown",
         [=](const Batch& batch) {
           py::array_t<float> rows(n_by(batch, kFlownNumbers));
           in_turn(batch, [&] { batch.flown(all_of(rows)); });
           return rows;
         },
         [=](Batch& batch, const py::object& value) {
           const auto rows = floats(value, "flown", n_by(batch, kFlownNumbers));
           in_turn(batch, [&] { batch.set_flown(rows); });
         })
      .def(
          "pullback",
          [=](const Batch& batch, const py::object& before, const py::object& command, const py::object& d_after, int ticks) {
            const auto b = floats(before, "before", n_by(batch, kFlownNumbers));
            const auto c = floats(command, "command", n_by(batch, 4));
            const auto d = floats(d_after, "d_after", n_by(batch, kFlownNumbers));
            py::array_t<float> d_before(n_by(batch, kFlownNumbers)), d_command(n_by(batch, 4));
            const std::span by_state = all_of(d_before), by_command = all_of(d_command);
            released([&] { batch.pullback(b, c, d, ticks, by_state, by_command); });
            return py::make_tuple(d_before, d_command);
          },
          py::arg("before"), py::arg("command"), py::arg("d_after"), py::arg("ticks") = 1);
}

}  // namespace flockstep::bindings
