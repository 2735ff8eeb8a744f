#include "flockstep/batch.hpp"

#include <pybind11/stl.h>

#include <numeric>

#include "arrays.hpp"
#include "camera.hpp"
#include "names.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

using Worlds = std::vector<std::shared_ptr<World>>;

py::ssize_t size_of(const Batch& batch) { return batch.config().num_drones; }
Shape n_by(const Batch& batch, py::ssize_t columns) { return {size_of(batch), columns}; }
Shape scan_shape(const Batch& batch) {
  const BatchConfig& config = batch.config();
  return {size_of(batch), config.has_lidar ? config.lidar.rows() : 0, config.has_lidar ? config.lidar.columns() : 0};
}

AutoresetMode autoreset_mode(const std::string& text) {
  if (text == "next_step") return AutoresetMode::next_step;
  if (text == "same_step") return AutoresetMode::same_step;
  if (text == "disabled") return AutoresetMode::disabled;
  throw py::value_error("autoreset_mode: expected \"next_step\", \"same_step\" or \"disabled\", got \"" + text + "\"");
}

// Letting go of a batch waits for its threads.
struct Released {
  void operator()(Batch* batch) const {
    const py::gil_scoped_release release;
    std::default_delete<Batch>()(batch);
  }
};

std::unique_ptr<Batch, Released> make_batch(const Worlds& worlds, int num_drones, const std::optional<LidarConfig>& lidar,
                                            const std::optional<PoseSensorConfig>& pose_sensor,
                                            const std::optional<NavigationConfig>& task, const std::optional<DroneModel>& drone,
                                            const std::vector<CameraConfig>& cameras, const std::string& backend,
                                            const std::string& autoreset, int num_threads, int block_size,
                                            const py::object& world_index) {
  BatchConfig config;
  config.num_drones = num_drones;
  config.num_threads = num_threads;
  config.block_size = block_size;
  config.autoreset_mode = autoreset_mode(autoreset);
  config.has_lidar = lidar.has_value();
  config.lidar = lidar.value_or(LidarConfig());
  config.pose_sensor = pose_sensor.value_or(PoseSensorConfig());
  config.cameras = cameras;
  config.camera_backend = camera_backend(backend);
  config.task = task ? TaskKind::navigation : TaskKind::none;
  config.navigation = task.value_or(NavigationConfig());
  const auto index = integers<std::int32_t>(world_index, "world_index", {num_drones});
  auto batch = [&] {  // worlds are prepared for tracing, backends timed
    const py::gil_scoped_release release;
    auto made = std::make_unique<Batch>(config, Batch::Worlds(worlds.begin(), worlds.end()),
                                        drone.value_or(DroneModel::quadrotor650()), index);
    return std::unique_ptr<Batch, Released>(made.release());
  }();
  warn(*batch);
  return batch;
}

// A view of one array of the state, kept alive by its batch.
template <class T, class Get>
auto state_view(const Get& get, py::ssize_t columns = 0) {
  return [get, columns](const py::object& self) {
    const auto& batch = self.cast<const Batch&>();
    const auto& array = get(batch);
    return view<T>(self, array.data(), columns == 0 ? Shape{size_of(batch)} : n_by(batch, columns));
  };
}

void require_task(const Batch& batch) {
  if (batch.config().task == TaskKind::none) throw std::runtime_error("this Batch has no built-in task: give it one (task=...)");
}

template <class T, class Member>
auto output_view(Member member, py::ssize_t columns = 0, bool writable = false) {
  return [member, columns, writable](const py::object& self) {
    const auto& batch = self.cast<const Batch&>();
    require_task(batch);
    const py::ssize_t width = columns < 0 ? batch.observation_size() : columns;
    return view<T>(self, (batch.outputs().*member).data(), width == 0 ? Shape{size_of(batch)} : n_by(batch, width), writable);
  };
}

// The same of images.
template <class Member>
auto image_view(Member member, bool writable = false) {
  return [member, writable](const py::object& self) {
    const auto& batch = self.cast<const Batch&>();
    require_task(batch);
    if (batch.image_size() == 0) {
      throw std::runtime_error("this Batch's task observes no pixels: give it one that does (observation=\"pixels\")");
    }
    const CameraConfig& camera = batch.config().cameras[0];
    return view<std::uint8_t>(self, (batch.outputs().*member).data(), {size_of(batch), 3, camera.height_px, camera.width_px},
                              writable);
  };
}

// The contact of a batch's last move: views into the batch.
struct ContactView {
  py::array_t<bool> hit, inside;
  py::array_t<float> fraction, point, normal;
};

ContactView contact_of(const py::object& self) {
  const auto& batch = self.cast<const Batch&>();
  const ContactState& contact = batch.state().contact;
  return {view<bool>(self, contact.hit.data(), {size_of(batch)}), view<bool>(self, contact.inside.data(), {size_of(batch)}),
          view<float>(self, contact.fraction.data(), {size_of(batch)}), view<float>(self, contact.point.data(), n_by(batch, 3)),
          view<float>(self, contact.normal.data(), n_by(batch, 3))};
}

void step(Batch& batch, const py::object& actions) {
  require_task(batch);
  const ActionKind kind = batch.config().navigation.action;
  if (is_discrete(kind)) {
    const auto input = integers<std::int64_t>(actions, "actions", {size_of(batch)});
    released(batch, [&] { batch.step(std::span<const std::int64_t>(input)); });
  } else {
    const Input<float> input(actions, "actions", n_by(batch, kind == ActionKind::displacement ? 3 : 4), "f", "floats");
    released(batch, [&] { batch.step(std::span<const float>(input)); });
  }
}

// The one of that name, or all.
std::vector<std::size_t> chosen_cameras(const Batch& batch, const std::optional<std::string>& name) {
  if (name) return {batch.camera_index(*name)};
  if (batch.config().cameras.empty())
    throw py::value_error("camera: expected a Batch with cameras (cameras=[...]), got one without");
  std::vector<std::size_t> all(batch.config().cameras.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  return all;
}

py::array_t<float> random(const Batch& batch, std::uint32_t stream, int count) {
  py::array_t<float> numbers(n_by(batch, std::max(count, 0)));
  batch.random(stream, count, {numbers.mutable_data(), static_cast<std::size_t>(numbers.size())});
  return numbers;
}

py::array_t<float> per_ray(const Batch& batch, void (Batch::*fill)(std::span<float>) const) {
  Shape shape = scan_shape(batch);
  shape.push_back(3);
  py::array_t<float> array(shape);
  (batch.*fill)({array.mutable_data(), static_cast<std::size_t>(array.size())});
  return array;
}

}  // namespace

void register_batch(py::module_& module) {
  py::class_<ContactView>(module, "Contact", "Where the last motion of each drone ended.")
      .def_readonly("hit", &ContactView::hit)
      .def_readonly("inside", &ContactView::inside)
      .def_readonly("fraction", &ContactView::fraction)
      .def_readonly("point", &ContactView::point)
      .def_readonly("normal", &ContactView::normal);

  const auto none = py::none();
  py::class_<Batch, std::unique_ptr<Batch, Released>>(module, "Batch", "N drone slots over W worlds, stepped together.")
      .def(py::init(&make_batch), py::arg("worlds"), py::arg("num_drones") = 1, py::kw_only(), py::arg("lidar") = none,
           py::arg("pose_sensor") = none, py::arg("task") = none, py::arg("drone") = none,
           py::arg("cameras") = std::vector<CameraConfig>(), py::arg("camera_backend") = "raycast",
           py::arg("autoreset_mode") = "next_step", py::arg("num_threads") = 0, py::arg("block_size") = BatchConfig().block_size,
           py::arg("world_index") = none)
      .def_property_readonly("num_drones", [](const Batch& batch) { return batch.config().num_drones; })
      .def_property_readonly("num_threads", &Batch::num_threads)
      .def_property_readonly("worlds",
                             [](const Batch& batch) {
                               Worlds worlds;
                               for (const auto& world : batch.worlds()) worlds.push_back(std::const_pointer_cast<World>(world));
                               return worlds;
                             })
      .def_property_readonly("drone", &Batch::drone)
      .def_property_readonly("position", state_view<float>([](const Batch& b) -> auto& { return b.state().position; }, 3))
      .def_property_readonly("quat_wxyz", state_view<float>([](const Batch& b) -> auto& { return b.state().quat_wxyz; }, 4))
      .def_property_readonly("active", state_view<bool>([](const Batch& b) -> auto& { return b.state().active; }))
      .def_property_readonly("world_index",
                             state_view<std::int32_t>([](const Batch& b) -> auto& { return b.state().world_index; }))
      .def_property_readonly("episode", state_view<std::int64_t>([](const Batch& b) -> auto& { return b.state().episode; }))
      .def_property_readonly("sensed_position",
                             state_view<float>([](const Batch& b) -> auto& { return b.state().sensed_position; }, 3))
      .def_property_readonly("sensed_quat_wxyz",
                             state_view<float>([](const Batch& b) -> auto& { return b.state().sensed_quat_wxyz; }, 4))
      .def_property_readonly("contact", &contact_of)
      .def_property_readonly("lidar_ranges",
                             [](const py::object& self) {
                               const auto& batch = self.cast<const Batch&>();
                               return view<float>(self, batch.state().lidar_ranges.data(), scan_shape(batch));
                             })
      .def_property_readonly("lidar_max_range_m",
                             [](const py::object& self) {
                               const auto& batch = self.cast<const Batch&>();
                               return view<float>(self, batch.lidar_max_range_m().data(), {size_of(batch)});
                             })
      .def("lidar_config_of", &Batch::lidar_config, py::arg("index"))
      .def_property_readonly("lidar_directions", [](const Batch& batch) { return per_ray(batch, &Batch::lidar_directions); })
      .def_property_readonly("lidar_points", [](const Batch& batch) { return per_ray(batch, &Batch::lidar_points); })
      .def(
          "set_pose",
          [](Batch& batch, const py::object& position, const py::object& quat_wxyz, const py::object& mask) {
            batch.set_pose(floats(position, "position", n_by(batch, 3)), floats(quat_wxyz, "quat_wxyz", n_by(batch, 4)),
                           flags(mask, "mask", size_of(batch)));
          },
          py::arg("position") = none, py::arg("quat_wxyz") = none, py::arg("mask") = none)
      .def(
          "move",
          [](const py::object& self, const py::object& position, const py::object& quat_wxyz, const py::object& mask) {
            auto& batch = self.cast<Batch&>();
            const auto p = floats(position, "position", n_by(batch, 3));
            const auto q = floats(quat_wxyz, "quat_wxyz", n_by(batch, 4));
            const auto m = flags(mask, "mask", size_of(batch));
            released(batch, [&] { batch.move(p, q, m); });
            return contact_of(self);
          },
          py::arg("position") = none, py::arg("quat_wxyz") = none, py::arg("mask") = none)
      .def(
          "sense",
          [](Batch& batch, const py::object& mask) {
            const auto m = flags(mask, "mask", size_of(batch));
            released(batch, [&] { batch.sense(m); });
          },
          py::arg("mask") = none)
      .def(
          "spawn",
          [](Batch& batch, const py::object& indices, const py::object& position, const py::object& quat_wxyz,
             const py::object& world_index) {
            const auto rows = integers<std::int64_t>(indices, "indices", {-1});
            const auto n = rows.given() ? static_cast<py::ssize_t>(rows.rows()) : 0;
            const auto p = floats(position, "position", {n, 3});
            const auto q = floats(quat_wxyz, "quat_wxyz", {n, 4});
            const auto w = integers<std::int32_t>(world_index, "world_index", {n});
            released(batch, [&] { batch.spawn(rows, p, q, w); });
          },
          py::arg("indices"), py::arg("position"), py::arg("quat_wxyz") = none, py::arg("world_index") = none)
      .def(
          "remove",
          [](Batch& batch, const py::object& indices) { batch.remove(integers<std::int64_t>(indices, "indices", {-1})); },
          py::arg("indices"))
      .def(
          "set_world",
          [](Batch& batch, const py::object& world_index, const py::object& mask) {
            batch.set_world(integers<std::int32_t>(world_index, "world_index", {size_of(batch)}),
                            flags(mask, "mask", size_of(batch)));
          },
          py::arg("world_index"), py::arg("mask") = none)
      .def(
          "set_lidar",
          [](Batch& batch, const py::object& mask, std::optional<float> max_range_m, std::optional<float> hfov_deg,
             std::optional<float> vfov_deg, const std::optional<std::array<float, 3>>& offset_m,
             const std::optional<std::array<float, 4>>& quat_wxyz) {
            batch.set_lidar({max_range_m, hfov_deg, vfov_deg, offset_m, quat_wxyz}, flags(mask, "mask", size_of(batch)));
          },
          py::arg("mask") = none, py::kw_only(), py::arg("max_range_m") = none, py::arg("hfov_deg") = none,
          py::arg("vfov_deg") = none, py::arg("offset_m") = none, py::arg("quat_wxyz") = none)
      .def("camera", &camera_view, py::arg("name") = "front")
      .def(
          "capture",
          [](Batch& batch, const py::object& mask, const std::optional<std::string>& camera) {
            const auto m = flags(mask, "mask", size_of(batch));
            const auto chosen = chosen_cameras(batch, camera);
            released(batch, [&] {
              for (const std::size_t index : chosen) batch.capture(index, m);
            });
          },
          py::arg("mask") = none, py::arg("camera") = none)
      .def(
          "set_capture_mode",
          [](Batch& batch, const std::string& mode, const std::optional<std::string>& camera) {
            const CaptureMode chosen_mode = capture_mode(mode);
            for (const std::size_t index : chosen_cameras(batch, camera)) batch.set_capture_mode(index, chosen_mode);
          },
          py::arg("mode"), py::arg("camera") = none)
      .def(
          "set_camera",
          [](Batch& batch, const py::object& mask, const std::string& camera, std::optional<float> hfov_deg,
             std::optional<float> vfov_deg, const std::optional<std::array<float, 3>>& offset_m,
             const std::optional<std::array<float, 4>>& quat_wxyz) {
            batch.set_camera(batch.camera_index(camera), {hfov_deg, vfov_deg, offset_m, quat_wxyz},
                             flags(mask, "mask", size_of(batch)));
          },
          py::arg("mask") = none, py::arg("camera") = "front", py::kw_only(), py::arg("hfov_deg") = none,
          py::arg("vfov_deg") = none, py::arg("offset_m") = none, py::arg("quat_wxyz") = none)
      .def("camera_backend_report", &Batch::camera_backend_report)
      .def(
          "seed",
          [](Batch& batch, const py::object& seeds, const py::object& mask) {
            batch.seed(integers<std::uint64_t>(seeds, "seeds", {size_of(batch)}), flags(mask, "mask", size_of(batch)));
          },
          py::arg("seeds"), py::arg("mask") = none)
      .def(
          "begin_episode", [](Batch& batch, const py::object& mask) { batch.begin_episode(flags(mask, "mask", size_of(batch))); },
          py::arg("mask") = none)
      .def("random", &random, py::arg("stream"), py::arg("count"))
      .def(
          "reset",
          [](Batch& batch, const py::object& seeds, const py::object& mask) {
            const auto s = integers<std::uint64_t>(seeds, "seeds", {size_of(batch)});
            const auto m = flags(mask, "mask", size_of(batch));
            released(batch, [&] { batch.reset(s, m); });
          },
          py::arg("seeds") = none, py::arg("mask") = none)
      .def("step", &step, py::arg("actions"))
      .def_property_readonly("observation", output_view<float>(&Outputs::observation, -1, true))
      .def_property_readonly("final_observation", output_view<float>(&Outputs::final_observation, -1))
      .def_property_readonly("image", image_view(&Outputs::image, true))
      .def_property_readonly("final_image", image_view(&Outputs::final_image))
      .def_property_readonly("reward", output_view<float>(&Outputs::reward, 0, true))
      .def_property_readonly("reward_terms", output_view<float>(&Outputs::reward_terms, kNumRewardTerms))
      .def_property_readonly("terminated", output_view<bool>(&Outputs::terminated))
      .def_property_readonly("truncated", output_view<bool>(&Outputs::truncated))
      .def_property_readonly("success", output_view<bool>(&Outputs::success))
      .def_property_readonly("crashed", output_view<bool>(&Outputs::crashed))
      .def_property_readonly("episode_return", output_view<double>(&Outputs::episode_return))
      .def_property_readonly("episode_length", output_view<std::int64_t>(&Outputs::episode_length))
      .def_property_readonly("goal_index",
                             [](const py::object& self) {
                               const auto& batch = self.cast<const Batch&>();
                               return view<std::int32_t>(self, batch.goal_index().data(), {size_of(batch)});
                             })
      .def("snapshot",
           [](Batch& batch) {
             std::string blob;
             released(batch, [&] { blob = batch.snapshot(); });
             return py::bytes(blob);
           })
      .def(
          "restore",
          [](Batch& batch, const py::bytes& bytes) {
            const std::string blob = bytes;
            released(batch, [&] { batch.restore(blob); });
          },
          py::arg("blob"));
}

}  // namespace flockstep::bindings
