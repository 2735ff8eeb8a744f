// Query methods of World, whose class world.cpp registers, and plan().
#include "flockstep/survey.hpp"

#include <pybind11/stl.h>

#include <chrono>

#include "arguments.hpp"
#include "arrays.hpp"
#include "flockstep/planning.hpp"
#include "flockstep/world_report.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

py::array_t<float> boxes(const std::vector<Aabb>& list) {
  py::array_t<float> array({static_cast<py::ssize_t>(list.size()), py::ssize_t{2}, py::ssize_t{3}});
  float* out = array.mutable_data();
  for (const Aabb& box : list) {
    out = std::copy_n(box.min.data(), 3, out);
    out = std::copy_n(box.max.data(), 3, out);
  }
  return array;
}

std::vector<Vec3> points_of(const py::object& object, const char* field) {
  if (py::isinstance<py::sequence>(object) && py::len(object) == 0) return {};
  return points_of(floats(object, field, {-1, 3}));
}

std::optional<Vec3> point_of(const py::object& object, const char* field) {
  const Input<float> input = floats(object, field, {3});
  if (!input.given()) return std::nullopt;
  const std::span<const float> values = input;
  return Vec3(values[0], values[1], values[2]);
}

std::optional<Aabb> box_of(const py::object& object, const char* field) {
  const Input<float> input = floats(object, field, {2, 3});
  if (!input.given()) return std::nullopt;
  const std::span<const float> values = input;
  return Aabb{Vec3(values[0], values[1], values[2]), Vec3(values[3], values[4], values[5])};
}

py::dict object_list(const World& world) {
  const ObjectList list = released([&] { return objects(world); });
  py::dict result;
  result["boxes"] = boxes(list.boxes);
  result["materials"] = array_of(list.materials);
  std::vector<std::uint8_t> visible, solid;
  for (const Visibility visibility : list.visibility) {
    visible.push_back(is_visible(visibility));
    solid.push_back(is_solid(visibility));
  }
  result["visible"] = array_of(visible).attr("astype")("bool");
  result["solid"] = array_of(solid).attr("astype")("bool");
  return result;
}

py::dict cloud(const World& world, float spacing_m) {
  const PointCloud cloud = released([&] { return point_cloud(world, spacing_m); });
  py::dict result;
  result["points"] = rows(cloud.points);
  result["normals"] = rows(cloud.normals);
  result["semantic"] = array_of(cloud.semantic);
  result["objects"] = array_of(cloud.objects);
  return result;
}

// Returns a grid as an array that takes ownership of the memory.
template <class Seen, class T>
py::array_t<Seen> cells(const CellGrid& grid, std::vector<T>&& values) {
  auto owned = std::make_unique<std::vector<T>>(std::move(values));
  T* const data = owned->data();
  const py::capsule owner(owned.release(), [](void* memory) { delete static_cast<std::vector<T>*>(memory); });
  return view<Seen>(owner, data, {grid.size[0], grid.size[1], grid.size[2]}, true);
}

py::dict placed(const CellGrid& grid) {
  py::dict result;
  result["origin"] = rows({&grid.origin, 1}).attr("reshape")(3);
  result["cell_m"] = grid.cell_m;
  return result;
}

py::dict occupied_cells(const World& world, float cell_m, const py::object& box) {
  const std::optional<Aabb> within = box_of(box, "box");
  OccupancyGrid made = released([&] { return occupancy(world, cell_m, within); });
  py::dict result = placed(made.grid);
  result["occupied"] = cells<bool>(made.grid, std::move(made.occupied));
  return result;
}

py::dict distances(const World& world, float cell_m, const py::object& box) {
  const std::optional<Aabb> within = box_of(box, "box");
  DistanceGrid made = released([&] { return distance(world, cell_m, within); });
  py::dict result = placed(made.grid);
  result["distance_m"] = cells<float>(made.grid, std::move(made.distance_m));
  return result;
}

py::tuple nearest_surfaces(const World& world, const py::object& points) {
  const Input<float> rows_given = floats(points, "points", {-1, 3});
  if (!rows_given.given()) throw py::value_error("points: expected an array (K, 3), got None");
  const NearestSurfaces found = released([&] { return nearest(world, rows_given); });
  return py::make_tuple(rows(found.points), array_of(found.distance_m), array_of(found.objects));
}

std::shared_ptr<World> with_markers(const World& world, const py::object& start, const py::object& goal,
                                    const py::object& waypoints, const py::object& spawn_box) {
  Markers markers{.radius = world.markers().radius,
                  .start = point_of(start, "start"),
                  .waypoints = points_of(waypoints, "waypoints"),
                  .goal = point_of(goal, "goal"),
                  .spawn_box = box_of(spawn_box, "spawn_box")};
  return std::const_pointer_cast<World>(released([&] { return world.with_markers(std::move(markers)); }));
}

py::array_t<float> places(const World& world, std::size_t count, std::uint64_t seed, const std::optional<float>& clearance_m,
                          float max_height_m, const py::object& box, const py::object& reachable_from,
                          const py::object& given_drone, float cell_m) {
  const DroneModel drone = drone_argument(given_drone);
  const FreePlacesConfig config{seed,  clearance_m, max_height_m, box_of(box, "box"), point_of(reachable_from, "reachable_from"),
                                cell_m};
  return rows(released([&] { return free_places(world, drone, count, config); }));
}

std::shared_ptr<World> with_drawn_markers(const World& world, std::uint64_t seed, const std::optional<float>& distance_m,
                                          const std::optional<float>& clearance_m, float max_height_m, const py::object& box,
                                          const py::object& given_drone, float cell_m, bool waypoints) {
  const DroneModel drone = drone_argument(given_drone);
  const FreePlacesConfig config{seed, clearance_m, max_height_m, box_of(box, "box"), std::nullopt, cell_m};
  return std::const_pointer_cast<World>(
      released([&] { return world.with_markers(drawn_markers(world, drone, config, distance_m, waypoints)); }));
}

py::dict report(const World& world, const py::object& given_drone) {
  const DroneModel drone = drone_argument(given_drone);
  const WorldReport report = released([&] { return check(world, drone); });
  const Markers& markers = world.markers();
  const Vec3 size = world.bounds().max - world.bounds().min;
  py::dict result;
  result["name"] = world.name();
  result["size_m"] = py::make_tuple(size.x(), size.y(), size.z());
  result["primitives"] = world.primitives().size();
  result["triangles"] = report.triangles;
  result["objects"] = report.objects;
  result["open_edges"] = report.open_edges;
  result["crowded_edges"] = report.crowded_edges;
  result["materials"] = world.materials().size();
  result["textures"] = world.textures().size();
  result["texture_bytes"] = report.texture_bytes;
  result["start"] = markers.start.has_value();
  result["waypoints"] = markers.waypoints.size();
  result["goal"] = markers.goal.has_value();
  result["spawn_box"] = markers.spawn_box.has_value();
  result["not_read"] = std::vector<std::string>(world.ignored().begin(), world.ignored().end());
  result["not_navigable"] = report.not_navigable.empty() ? py::object(py::none()) : py::str(report.not_navigable);
  return result;
}

py::object plan_path(const py::object& given_world, const py::object& start, const py::object& goals, const py::object& drone,
                     float cell_m, const std::optional<py::function>& progress) {
  const std::shared_ptr<World> world = world_argument(given_world);
  const Input<float> start_input = floats(start, "start", {3});
  if (!start_input.given()) throw py::value_error("start: expected an array of real numbers, got None");
  const std::span<const float> from = start_input;
  const std::vector<Vec3> points = points_of(floats(goals, "goals", {-1, 3}));
  const DroneModel model = drone_argument(drone);
  const Vec3 first(from[0], from[1], from[2]);
  Progress report;
  if (progress) {
    report = [&progress, next = std::chrono::steady_clock::now()](double share) mutable {
      const auto now = std::chrono::steady_clock::now();
      if (now < next) return;  // the interpreter lock costs more than the search between two calls
      next = now + std::chrono::milliseconds(100);
      const py::gil_scoped_acquire acquire;
      (*progress)(share);
    };
  }
  const std::optional<std::vector<Vec3>> path = released([&] { return plan(*world, model, first, points, cell_m, report); });
  if (!path) return py::none();
  return rows(*path);
}

}  // namespace

void register_survey(py::module_& module) {
  const FreePlacesConfig usual;
  const py::object none = py::none();
  auto world = static_cast<py::class_<World, std::shared_ptr<World>>>(module.attr("World"));
  world.def("objects", &object_list)
      .def("point_cloud", &cloud, py::arg("spacing_m"))
      .def("occupancy", &occupied_cells, py::arg("cell_m"), py::arg("box") = none)
      .def("distance", &distances, py::arg("cell_m"), py::arg("box") = none)
      .def("nearest", &nearest_surfaces, py::arg("points"))
      .def("with_markers", &with_markers, py::kw_only(), py::arg("start") = none, py::arg("goal") = none,
           py::arg("waypoints") = none, py::arg("spawn_box") = none)
      .def("free_places", &places, py::arg("count"), py::arg("seed") = 0, py::kw_only(), py::arg("clearance_m") = none,
           py::arg("max_height_m") = usual.max_height_m, py::arg("box") = none, py::arg("reachable_from") = none,
           py::arg("drone") = none, py::arg("cell_m") = usual.cell_m)
      .def("with_drawn_markers", &with_drawn_markers, py::arg("seed") = 0, py::kw_only(), py::arg("distance_m") = none,
           py::arg("clearance_m") = none, py::arg("max_height_m") = usual.max_height_m, py::arg("box") = none,
           py::arg("drone") = none, py::arg("cell_m") = usual.cell_m, py::arg("waypoints") = false)
      .def("check", &report, py::arg("drone") = none);
  module.def("plan", &plan_path, py::arg("world"), py::arg("start"), py::arg("goals"), py::arg("drone") = py::none(),
             py::arg("cell_m") = 0.1F, py::arg("progress") = py::none());
}

}  // namespace flockstep::bindings
