#include "render/gl/renderer.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <tuple>
#include <unordered_map>
#include <vector>

#include "base/platform.hpp"
#include "render/gl/atlas.hpp"
#include "render/gl/model.hpp"
#include "render/gl/worker.hpp"

namespace flockstep::render {
namespace {

constexpr int kMaxSide = 4096;  // px; larger images are drawn in parts
// Maximum number of pixels in a round. It bounds the memory of each atlas and readback, which take up to 32 bytes per pixel.
constexpr std::int64_t kMaxPixels = std::int64_t{kMaxSide} * kMaxSide;
// Larger rounds gain nothing on a software device. While it draws one round, the caller writes the frames of the previous
// one.
constexpr std::int64_t kMaxSoftwarePixels = std::int64_t{1} << 20U;
constexpr std::size_t kMaxSoftwareTriangles = std::size_t{1} << 24U;  // per round, a few seconds of drawing
constexpr std::size_t kGrain = 1U << 16U;                             // pixels that justify a separate job

// Returns a key: cameras with equal keys share an atlas.
auto kind_of(const CameraConfig& camera) {
  const CameraOutputs& outputs = camera.outputs;
  return std::tuple(camera.width_px, camera.height_px, camera.samples_per_pixel, camera.near_m, camera.far_m, outputs.any_color(),
                    outputs.depth, outputs.semantic || outputs.instance, outputs.normal, camera.shadows);
}

GlPass pass_of(const CameraConfig& camera) {
  const CameraOutputs& outputs = camera.outputs;
  GlPass pass{.near_m = camera.near_m, .far_m = camera.far_m};
  pass.traits.writes = {outputs.any_color(), outputs.depth, outputs.semantic || outputs.instance, outputs.normal};
  pass.traits.shadows = outputs.any_color() && camera.shadows;
  if (outputs.any_color()) {
    while ((pass.samples + 1) * (pass.samples + 1) <= camera.samples_per_pixel) ++pass.samples;
  }
  return pass;
}

// Returns the number of tiles in an atlas. It is a power of two, so that an atlas can be reused if the number of images
// varies from step to step.
int roomy(int tiles, int most) { return std::min(static_cast<int>(std::bit_ceil(static_cast<unsigned int>(tiles))), most); }

// Returns the number of triangles that a request may show.
std::size_t triangles_of(const RenderRequest& request) {
  std::size_t triangles = request.world->triangles().triangles.size();
  const auto triangles_of_mesh = [](const BodySurface& surface) {
    return surface.mesh == nullptr ? std::size_t{0} : (*surface.mesh)->triangles().triangles.size();
  };
  for (std::size_t i = 0; i < request.bodies.shapes.count; ++i) triangles += triangles_of_mesh(request.bodies.surface(i));
  if (request.drones.shapes.count > 0) triangles += request.drones.shapes.count * triangles_of_mesh(request.drones.surface(0));
  return triangles;
}

int pieces(int length, int most) { return (length + most - 1) / most; }

}  // namespace

struct GlRenderer::Impl {
  explicit Impl(std::chrono::milliseconds patience) : worker(patience) {}

  long process = process_id();
  GlWorker worker;
  struct KnownWorld {
    std::uint32_t model;
    bool has_grid = false;
  };
  std::unordered_map<const World*, KnownWorld> worlds;
  struct KnownMesh {
    std::shared_ptr<const World> world;  // keeps its address from being used again
    std::uint32_t model;
    bool has_tree = false;
  };
  std::unordered_map<const World*, KnownMesh> meshes;  // worlds of mesh bodies
  std::vector<RenderRequest> requests;
  std::vector<std::uint32_t> order;  // indices of the requests, grouped by kind of camera
  std::vector<FramePart> parts;      // one per camera of the task
  std::size_t rounds_left = 0;       // rounds of the task that have not been taken

  // Returns the number of the world's model. Adds the model and its sun grid to the next task if they are not on the device
  // yet.
  std::uint32_t model_of(const World& world, bool shadows) {
    auto found = worlds.find(&world);
    if (found == worlds.end()) {
      worker.task().models.emplace_back(world);
      found = worlds.emplace(&world, KnownWorld{next_model()}).first;
    }
    KnownWorld& known = found->second;
    if (shadows && !known.has_grid) {
      worker.task().grids.push_back({known.model, GlSunGrid(world)});
      known.has_grid = true;
    }
    return known.model;
  }

  // The same for the world of a mesh body, with its caster tree.
  std::uint32_t model_of_mesh(const std::shared_ptr<const World>& world, bool shadows) {
    auto found = meshes.find(world.get());
    if (found == meshes.end()) {
      found = meshes.emplace(world.get(), KnownMesh{world, next_model()}).first;
      worker.task().models.emplace_back(*world, GlModel::Of::mesh_body);
    }
    KnownMesh& known = found->second;
    if (shadows && !known.has_tree) {
      worker.task().trees.push_back({known.model, GlCasterTree(*world)});
      known.has_tree = true;
    }
    return known.model;
  }

  std::uint32_t next_model() const { return static_cast<std::uint32_t>(worlds.size() + meshes.size()); }

  // Calls f(round, pixels) for each remaining round, in order, as it arrives.
  template <class F>
  void take_rounds(const F& f) {
    if (rounds_left == 0) return;
    const std::vector<GlRound>& rounds = worker.task().rounds;
    while (rounds_left != 0) {
      const Pixels& pixels = worker.wait();
      f(rounds[rounds.size() - rounds_left], pixels);
      worker.release();
      --rounds_left;
    }
    worker.task().models.clear();
    worker.task().grids.clear();
    worker.task().trees.clear();
  }

  void plan();
  void plan_group(std::span<const std::uint32_t> group);
  void write(const GlRound& round, const Pixels& pixels, Workers& workers) const;
};

GlRenderer::GlRenderer(std::chrono::milliseconds patience) : impl_(std::make_unique<Impl>(patience)) {}

GlRenderer::~GlRenderer() {
  // The thread runs only in the parent, and this copy of its mutex may stay locked forever.
  if (process_id() != impl_->process) static_cast<void>(impl_.release());
}

GlRenderer::Impl& GlRenderer::impl() {
  if (process_id() != impl_->process) {
    throw GlUnavailable("OpenGL was set up before this process was forked, and works only in its parent");
  }
  return *impl_;
}

std::string GlRenderer::description() const { return impl_->worker.description(); }

void GlRenderer::start(std::span<const RenderRequest> requests) {
  Impl& self = impl();
  self.take_rounds([](const GlRound&, const Pixels&) {});  // left by a start() whose finish() was not called or threw
  self.requests.assign(requests.begin(), requests.end());
  self.plan();
  if (requests.empty()) return;
  self.worker.start();
  self.rounds_left = self.worker.task().rounds.size();
}

void GlRenderer::forget_worlds() {
  Impl& self = impl();
  self.take_rounds([](const GlRound&, const Pixels&) {});
  self.worlds.clear();
  self.meshes.clear();
  self.worker.task().forgets_models = true;
}

void GlRenderer::finish(Workers& workers) {
  Impl& self = impl();
  self.take_rounds([&](const GlRound& round, const Pixels& pixels) { self.write(round, pixels, workers); });
}

void GlRenderer::Impl::plan() {
  GlTask& task = worker.task();
  task.bodies.solids.clear();
  task.bodies.meshes.clear();
  task.cameras.clear();
  task.rounds.clear();
  parts.clear();
  order.resize(requests.size());
  for (std::size_t i = 0; i < requests.size(); ++i) order[i] = static_cast<std::uint32_t>(i);
  const auto same_kind = [&](std::uint32_t a, std::uint32_t b) {
    return requests[a].camera == requests[b].camera || kind_of(*requests[a].camera) == kind_of(*requests[b].camera);
  };
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    if (!same_kind(a, b)) return kind_of(*requests[a].camera) < kind_of(*requests[b].camera);
    return a < b;
  });
  for (std::size_t first = 0; first < order.size();) {
    std::size_t last = first + 1;
    while (last < order.size() && same_kind(order[first], order[last])) ++last;
    plan_group(std::span<const std::uint32_t>(order).subspan(first, last - first));
    first = last;
  }
}

void GlRenderer::Impl::plan_group(std::span<const std::uint32_t> group) {
  GlTask& task = worker.task();
  const CameraConfig& camera = *requests[group[0]].camera;
  const GlPass pass = pass_of(camera);
  const int side = std::min(worker.max_side(), kMaxSide);
  const int columns = pieces(camera.width_px * pass.samples, side);
  const int rows = pieces(camera.height_px * pass.samples, side);
  const AtlasSize tile{pieces(camera.width_px, columns), pieces(camera.height_px, rows), 1};
  const std::int64_t tile_pixels = static_cast<std::int64_t>(tile.pixels()) * pass.samples * pass.samples;
  std::int64_t by_size = (worker.is_software() ? kMaxSoftwarePixels : kMaxPixels) / tile_pixels;
  if (worker.is_software()) {  // so that progress is reported every few seconds
    std::size_t triangles = 1;
    for (const std::uint32_t i : group) triangles = std::max(triangles, triangles_of(requests[i]));
    by_size = std::min(by_size, static_cast<std::int64_t>(kMaxSoftwareTriangles / triangles));
  }
  const int most =
      std::max(1, static_cast<int>(std::min<std::int64_t>(worker.max_side() / (tile.height * pass.samples), by_size)));

  const std::size_t first_camera = task.cameras.size();
  const RenderRequest* last = nullptr;
  std::size_t first_body = 0, first_mesh = 0;
  for (const std::uint32_t i : group) {
    const RenderRequest& request = requests[i];
    // Drones of one env share its bodies, and see the same drones except themselves.
    const VisibleBodies& drones = request.drones;
    if (last == nullptr || last->bodies.shapes.position != request.bodies.shapes.position ||
        last->drones.shapes.position != drones.shapes.position || last->world != request.world) {
      first_body = task.bodies.solids.size();
      first_mesh = task.bodies.meshes.size();
      for (const VisibleBodies& visible : {request.bodies, drones}) {
        append_bodies(
            visible, *request.world, pass.traits.shadows,
            [&](const std::shared_ptr<const World>& mesh) { return model_of_mesh(mesh, pass.traits.shadows); }, task.bodies);
      }
    }
    last = &request;
    std::uint32_t hidden_ids = 0;
    if (const std::size_t own = drones.shapes.hidden; own != trace::Bodies::kNone) {
      hidden_ids = pack_ids({.semantic = drones.surface(own).semantic, .instance = drones.instance(own)});
    }
    const auto num_bodies = static_cast<std::uint32_t>(task.bodies.solids.size() - first_body);
    const auto num_meshes = static_cast<std::uint32_t>(task.bodies.meshes.size() - first_mesh);
    const std::uint32_t model = model_of(*request.world, pass.traits.shadows);
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        const int left = column * tile.width;
        const int top = row * tile.height;
        parts.push_back(
            {i, left, top, std::min(tile.width, camera.width_px - left), std::min(tile.height, camera.height_px - top)});
        task.cameras.push_back({model, request.position, request.rotation, request.pinhole->fx, request.pinhole->fy,
                                request.pinhole->cx - static_cast<float>(left), request.pinhole->cy - static_cast<float>(top),
                                static_cast<std::uint32_t>(first_body), num_bodies, static_cast<std::uint32_t>(first_mesh),
                                num_meshes, hidden_ids});
      }
    }
  }
  const auto num_cameras = static_cast<int>(task.cameras.size() - first_camera);
  for (int first = 0; first < num_cameras; first += most) {
    const int count = std::min(most, num_cameras - first);
    task.rounds.push_back(
        {{tile.width, tile.height, roomy(count, most)}, pass, first_camera + static_cast<std::size_t>(first), count});
  }
}

void GlRenderer::Impl::write(const GlRound& round, const Pixels& pixels, Workers& workers) const {
  const auto count = static_cast<std::size_t>(round.count);
  const std::size_t tile_pixels = AtlasSize{round.size.width, round.size.height, 1}.pixels();
  const std::size_t grain = std::max<std::size_t>(1, kGrain / tile_pixels);
  workers.run((count + grain - 1) / grain, [&](std::size_t job, std::size_t) {
    for (std::size_t tile = job * grain; tile < std::min(count, (job + 1) * grain); ++tile) {
      const FramePart& part = parts[round.first_camera + tile];
      write_frame(pixels, round.size, tile, requests[part.request], part);
    }
  });
}

}  // namespace flockstep::render
