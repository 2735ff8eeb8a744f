#include "lidar.hpp"

#include <pybind11/stl.h>

#include "arrays.hpp"
#include "flockstep/batch.hpp"

namespace flockstep::bindings {
namespace {

// The LiDAR of a batch, which it keeps alive: its ranges are views.
struct LidarView {
  py::object owner;

  const Batch& batch() const { return owner.cast<const Batch&>(); }
  const Batch& scanned() const {
    batch().require_scan();
    return batch();
  }
  const LidarConfig& config() const { return *batch().config().lidar; }
  Shape shape() const { return {batch().config().num_drones(), config().rows(), config().columns()}; }
};

py::array_t<float> per_ray(const LidarView& lidar, void (Batch::*fill)(std::span<float>) const) {
  Shape shape = lidar.shape();
  shape.push_back(3);
  py::array_t<float> array(shape);
  (lidar.batch().*fill)({array.mutable_data(), static_cast<std::size_t>(array.size())});
  return array;
}

}  // namespace

py::object lidar_view(const py::object& batch, const std::optional<std::string>& name) {
  batch.cast<const Batch&>().require_lidar(name.value_or(""));
  return py::cast(LidarView{batch});
}

void register_lidar(py::module_& module) {
  py::class_<LidarView>(module, "Lidar", "The LiDAR of every drone of a batch.")
      .def_property_readonly("config", [](const LidarView& lidar) { return lidar.config(); })
      .def(
          "config_of", [](const LidarView& lidar, std::int64_t index) { return lidar.batch().lidar_config(index); },
          py::arg("index"))
      .def_property_readonly(
          "ranges",
          [](const LidarView& lidar) { return view<float>(lidar.owner, lidar.scanned().lidar_ranges().data(), lidar.shape()); })
      .def_property_readonly("max_range_m",
                             [](const LidarView& lidar) {
                               const Batch& batch = lidar.batch();
                               return view<float>(lidar.owner, batch.lidar_max_range_m().data(), {batch.config().num_drones()});
                             })
      .def_property_readonly("directions", [](const LidarView& lidar) { return per_ray(lidar, &Batch::lidar_directions); })
      .def_property_readonly("points", [](const LidarView& lidar) {
        lidar.scanned();
        return per_ray(lidar, &Batch::lidar_points);
      });
}

}  // namespace flockstep::bindings
