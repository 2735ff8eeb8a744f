#include "world_pool.hpp"

#include <pybind11/stl.h>

#include <memory>
#include <utility>

#include "released.hpp"

namespace flockstep::bindings {
namespace {

namespace py = pybind11;

// Worlds that the threads of flockstep.world_pool.Builds build. The wait for a world is in Python, so that Ctrl-C can end it.
class Builds final : public WorldSource {
 public:
  explicit Builds(py::object builds)
      : builds_(new py::object(std::move(builds)), [](py::object* object) {
          const py::gil_scoped_acquire acquire;
          std::default_delete<py::object>()(object);
        }) {}

  std::shared_ptr<const World> get(std::int32_t number) override {
    const py::gil_scoped_acquire acquire;
    return builds_->attr("get")(number).cast<std::shared_ptr<World>>();
  }

  void want(std::span<const std::int32_t> numbers) override {
    const py::gil_scoped_acquire acquire;
    py::list list;
    for (const std::int32_t number : numbers) list.append(number);
    builds_->attr("want")(list);
  }

 private:
  std::shared_ptr<py::object> builds_;
};

}  // namespace

std::optional<WorldPool> world_pool(const py::object& worlds, const BatchConfig& config) {
  const auto module = py::module_::import("flockstep.world_pool");
  if (!py::isinstance(worlds, module.attr("WorldPool"))) return std::nullopt;
  const py::cpp_function prepare([config](const World& world) { released([&] { build_ahead(world, config); }); });
  WorldPool pool{.size = worlds.attr("size").cast<std::int32_t>(), .fresh = worlds.attr("fresh").cast<double>()};
  pool.source = std::make_shared<Builds>(module.attr("Builds")(worlds, config.num_envs, prepare));
  return pool;
}

}  // namespace flockstep::bindings
