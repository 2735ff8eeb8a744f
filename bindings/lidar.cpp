// Batch.lidar: the LiDARs of all drones.

#include <pybind11/stl.h>

#include <optional>
#include <string>
#include <string_view>

#include "array_views.hpp"
#include "arrays.hpp"
#include "batch.hpp"
#include "convert.hpp"
#include "memory.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

// One LiDAR of a batch. Keeps the batch alive, because its ranges are views.
struct LidarView {
  py::object owner;
  std::size_t index;

  const Batch& batch() const { return owner.cast<const Batch&>(); }
  const Batch& scanned() const {
    batch().require_scan(index);
    return batch();
  }
  const LidarConfig& config() const { return batch().config().lidars[index]; }
  Shape shape() const { return {batch().config().num_drones(), config().rows(), config().columns()}; }
};

Viewed<LidarReadings> readings_of(const py::object& self, const char* name) {
  const auto& lidar = self.cast<const LidarView&>();
  const Batch& batch = name == std::string_view("ranges") ? lidar.scanned() : lidar.batch();
  return {batch.lidar_readings(lidar.index), memory_of(lidar.owner), items_of(lidar.config())};
}

py::array_t<float> per_ray(const LidarView& lidar, void (Batch::*fill)(std::span<float>, std::size_t) const) {
  const Batch& batch = lidar.batch();
  return in_turn(batch, [&] {  // the shape may change until then
    Shape shape = lidar.shape();
    shape.push_back(3);
    py::array_t<float> array(shape);
    (batch.*fill)({array.mutable_data(), static_cast<std::size_t>(array.size())}, lidar.index);
    return array;
  });
}

}  // namespace

void add_lidars(py::module_& module, BatchClass& batch_cls) {
  py::class_<LidarView> cls(module, "Lidar", "One LiDAR of every drone of a batch.");
  add_arrays<LidarReadings, &readings_of>(cls);
  cls.def_property_readonly("config", [](const LidarView& lidar) { return lidar.config(); })
      .def(
          "config_of",
          [](const LidarView& lidar, std::int64_t index) {
            const Batch& batch = lidar.batch();
            return in_turn(batch, [&] { return batch.lidar_config(index, lidar.index); });
          },
          py::arg("index"))
      .def_property_readonly("directions", [](const LidarView& lidar) { return per_ray(lidar, &Batch::lidar_directions); })
      .def_property_readonly("points", [](const LidarView& lidar) {
        lidar.scanned();
        return per_ray(lidar, &Batch::lidar_points);
      });
  batch_cls.def_property_readonly("lidars", [](const Batch& batch) { return batch.config().lidars; })
      .def_property_readonly("lidar_name",
                             [](const Batch& batch) -> std::optional<std::string> {
                               const auto& lidars = batch.config().lidars;
                               return lidars.empty() ? std::nullopt : std::optional(lidars[0].name);
                             })
      .def(
          "lidar",
          [](const py::object& batch, const std::optional<std::string>& name) {
            return LidarView{batch, batch.cast<const Batch&>().lidar_index(name.value_or(""))};
          },
          py::arg("name") = py::none())
      .def(
          "set_lidar",
          [](Batch& batch, const py::object& mask, const std::optional<std::string>& lidar, const py::kwargs& fields) {
            const std::size_t index = batch.lidar_index(lidar.value_or(""));
            const auto m = flags(mask, "mask", num_drones(batch));
            const auto change = change_of<LidarChange>(fields, "set_lidar");
            released(batch, [&] { batch.set_lidar(change, m, index); });
          },
          py::arg("mask") = py::none(), py::arg("lidar") = py::none());
}

}  // namespace flockstep::bindings
