#include "render/gl/renderer.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "render/gl/atlas.hpp"
#include "render/gl/model.hpp"
#include "render/gl/worker.hpp"
#include "trace/bodies.hpp"

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
                    outputs.depth, outputs.semantic || outputs.instance, outputs.normal);
}

GlPass pass_of(const CameraConfig& camera) {
  const CameraOutputs& outputs = camera.outputs;
  GlPass pass{.near_m = camera.near_m, .far_m = camera.far_m};
  pass.writes = {outputs.any_color(), outputs.depth, outputs.semantic || outputs.instance, outputs.normal};
  if (outputs.any_color()) {
    while ((pass.samples + 1) * (pass.samples + 1) <= camera.samples_per_pixel) ++pass.samples;
  }
  return pass;
}

// Returns the number of tiles in an atlas. It is a power of two, so that an atlas can be reused if the number of images
// varies from step to step.
int roomy(int tiles, int most) { return std::min(static_cast<int>(std::bit_ceil(static_cast<unsigned int>(tiles))), most); }

int pieces(int length, int most) { return (length + most - 1) / most; }

}  // namespace

// Shapes of bodies and markers. Each is a solid of size 1, at kLevels finenesses, each of which halves the distance of its
// chords.
constexpr std::array kSolids{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule};
constexpr std::size_t kLevels = 9;

struct GlRenderer::Impl {
  explicit Impl(std::chrono::milliseconds patience) : worker(patience) {}

  struct KnownModel {
    std::uint32_t number = 0;
    std::size_t triangles = 0;
  };

  struct KnownWorld {
    KnownModel model;
    std::vector<MarkerSphere> markers;
  };

  long process = process_id();
  GlWorker worker;
  std::uint32_t num_models = 0;
  std::map<std::pair<const World*, float>, KnownWorld> worlds;  // by the world that has the geometry, and focal_px
  std::set<std::shared_ptr<const World>> meshes;                // bodies' meshes, which might not live long enough
  std::array<std::optional<KnownModel>, kSolids.size() * kLevels> solids;
  std::vector<std::pair<const World*, std::uint32_t>> colors;  // where those of each world are in the scene
  std::size_t triangles = 0;                                   // triangles of the items that were added last
  float focal_px = 0.0F;                                       // focal length of the group that is planned, rounded up
  std::vector<RenderRequest> requests;
  std::vector<std::uint32_t> order;  // indices of the requests, grouped by kind of camera
  std::vector<FramePart> parts;      // one per camera of the task
  std::size_t rounds_left = 0;       // rounds of the task that have not been taken

  // Adds a model to the next task.
  KnownModel add(GlModel&& model) {
    const KnownModel known{num_models++, model.triangles.size()};
    worker.task().models.push_back(std::move(model));
    return known;
  }

  const KnownWorld& known(const World& world) {
    const World* const original = world.original() != nullptr ? world.original() : &world;
    const std::pair key(original, focal_px);
    auto found = worlds.find(key);
    if (found == worlds.end()) {
      found = worlds.emplace(key, KnownWorld{add(GlModel(*original, focal_px)), Appearance(*original).markers}).first;
    }
    return found->second;
  }

  const KnownModel& model_of(PrimitiveKind kind, float radius) {
    std::size_t level = 0;
    float chord_error = kCoarsest;
    for (; level + 1 < kLevels && chord_error * radius > chord_error_of(kind, radius, focal_px); ++level) chord_error *= 0.5F;
    const auto place = static_cast<std::size_t>(std::ranges::find(kSolids, kind) - kSolids.begin());
    std::optional<KnownModel>& known = solids[place * kLevels + level];
    if (!known) known = add(GlModel(kind, chord_error));
    return *known;
  }

  // Returns the index of the colours of the world's materials. A null pointer has one white material.
  std::uint32_t colors_of(const World* world) {
    const auto found = std::find_if(colors.rbegin(), colors.rend(), [&](const auto& known) { return known.first == world; });
    if (found != colors.rend()) return found->second;
    std::vector<GlColor>& table = worker.task().scene.colors;
    colors.emplace_back(world, static_cast<std::uint32_t>(table.size()));
    const auto add_color = [&](const std::array<float, 3>& base, const std::array<float, 3>& emission) {
      table.push_back({{base[0], base[1], base[2], 0.0F}, {emission[0], emission[1], emission[2], 0.0F}});
    };
    if (world == nullptr) add_color({1.0F, 1.0F, 1.0F}, {});
    for (const Material& material : world == nullptr ? std::span<const Material>() : world->materials()) {
      add_color(material.base_color, material.emissive);
    }
    return colors.back().second;
  }

  GlItem& add_item(const KnownModel& model, std::uint32_t first_color) {
    triangles += model.triangles;
    GlItem& item = worker.task().scene.items.emplace_back();
    item.model = model.number;
    item.first_color = first_color;
    return item;
  }

  // pose: of a solid, with its size.
  GlItem& add_solid(const Primitive& pose, const Surface& surface) {
    const Vec3& half = pose.half_extents;
    GlItem& item = add_item(model_of(pose.kind, half.x()), colors_of(nullptr));
    item.ids = pack_ids(surface);
    item.position = pose.center;
    item.rotation = pose.rotation.normalized().toRotationMatrix();
    item.radius = half.norm();
    const bool is_capsule = pose.kind == PrimitiveKind::capsule;
    item.scale = {half.x(), half.y(), is_capsule ? half.x() : half.z(), is_capsule ? half.z() - 2.0F * half.x() : 0.0F};
    item.color = surface.color;
    return item;
  }

  void add_world(const World& world) {
    const KnownWorld& shown = known(world);
    add_item(shown.model, colors_of(&world));
    const Vec3 half = Vec3::Constant(world.markers().radius);
    for (const MarkerSphere& marker : shown.markers) {
      add_solid({.kind = PrimitiveKind::sphere, .center = marker.center, .half_extents = half}, marker.surface).only_front = true;
    }
  }

  // The drone that carries the camera is hidden later; see TileCamera.
  void add_bodies(const VisibleBodies& bodies) {
    for (std::size_t i = 0; i < bodies.shapes.count; ++i) {
      if (bodies.shapes.radius[i] < 0.0F) continue;
      const BodySurface& appearance = bodies.surface(i);
      const Surface surface{.color = appearance.color, .semantic = appearance.semantic, .instance = bodies.instance(i)};
      if (appearance.mesh == nullptr) {
        add_solid(trace::posed_solid(bodies.shapes, i), surface);
        continue;
      }
      const std::shared_ptr<const World>& mesh = *appearance.mesh;
      meshes.insert(mesh);
      const trace::PosedMesh posed = trace::posed_mesh(bodies.shapes, i);
      GlItem& item = add_item(known(*mesh).model, colors_of(mesh.get()));
      item.ids = pack_ids(surface);
      item.position = posed.position;
      item.rotation = posed.to_local.transpose();
      item.radius = posed.radius;
    }
  }

  // Calls f(round, pixels) for each remaining round, in order, as it arrives.
  template <class F>
  void take_rounds(const F& f) {
    if (rounds_left == 0) return;
    const std::vector<GlRound>& rounds = worker.task().rounds;
    while (rounds_left != 0) {
      const AtlasPixels& pixels = worker.wait();
      f(rounds[rounds.size() - rounds_left], pixels);
      worker.release();
      --rounds_left;
    }
    worker.task().models.clear();
  }

  void plan();
  void plan_group(std::span<const std::uint32_t> group);
  void write(const GlRound& round, const AtlasPixels& pixels, Workers& workers) const;
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
  self.take_rounds([](const GlRound&, const AtlasPixels&) {});  // left by a start() whose finish() was not called or threw
  self.requests.assign(requests.begin(), requests.end());
  self.plan();
  if (requests.empty()) return;
  self.worker.start();
  self.rounds_left = self.worker.task().rounds.size();
}

void GlRenderer::finish(Workers& workers) {
  Impl& self = impl();
  self.take_rounds([&](const GlRound& round, const AtlasPixels& pixels) { self.write(round, pixels, workers); });
}

void GlRenderer::Impl::plan() {
  GlTask& task = worker.task();
  task.scene.items.clear();
  task.scene.colors.clear();
  task.scene.cameras.clear();
  task.rounds.clear();
  colors.clear();
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
  std::vector<TileCamera>& cameras = task.scene.cameras;
  const CameraConfig& camera = *requests[group[0]].camera;
  const GlPass pass = pass_of(camera);
  float longest = 0.0F;
  for (const std::uint32_t i : group) longest = std::max({longest, requests[i].optics->fx, requests[i].optics->fy});
  for (focal_px = 8.0F; focal_px < longest;) focal_px *= 4.0F;
  const int side = std::min(worker.max_side(), kMaxSide);
  const int columns = pieces(camera.width_px * pass.samples, side);
  const int rows = pieces(camera.height_px * pass.samples, side);
  const AtlasSize tile{pieces(camera.width_px, columns), pieces(camera.height_px, rows), 1};

  const std::size_t first_camera = cameras.size();
  const RenderRequest* last = nullptr;
  std::size_t first_item = 0, most_triangles = 1;
  for (const std::uint32_t i : group) {
    const RenderRequest& request = requests[i];
    // Drones of one env share its bodies, and see the same drones except themselves.
    const VisibleBodies& drones = request.drones;
    if (last == nullptr || last->bodies.shapes.position != request.bodies.shapes.position ||
        last->drones.shapes.position != drones.shapes.position || last->world != request.world) {
      first_item = task.scene.items.size();
      triangles = 0;
      add_world(*request.world);
      add_bodies(request.bodies);
      add_bodies(drones);
      most_triangles = std::max(most_triangles, triangles);
    }
    last = &request;
    std::uint32_t hidden_ids = 0;
    if (const std::size_t own = drones.shapes.hidden; own != trace::Bodies::kNone) {
      hidden_ids = pack_ids({.semantic = drones.surface(own).semantic, .instance = drones.instance(own)});
    }
    for (int row = 0; row < rows; ++row) {
      for (int column = 0; column < columns; ++column) {
        const int left = column * tile.width;
        const int top = row * tile.height;
        parts.push_back(
            {i, left, top, std::min(tile.width, camera.width_px - left), std::min(tile.height, camera.height_px - top)});
        cameras.push_back({request.world->light(), request.position, request.rotation, request.optics->fx, request.optics->fy,
                           request.optics->cx - static_cast<float>(left), request.optics->cy - static_cast<float>(top),
                           static_cast<std::uint32_t>(first_item),
                           static_cast<std::uint32_t>(task.scene.items.size() - first_item), hidden_ids});
      }
    }
  }

  const std::int64_t tile_pixels = static_cast<std::int64_t>(tile.pixels()) * pass.samples * pass.samples;
  std::int64_t by_size = (worker.is_software() ? kMaxSoftwarePixels : kMaxPixels) / tile_pixels;
  if (worker.is_software()) {  // so that progress is reported every few seconds
    by_size = std::min(by_size, static_cast<std::int64_t>(kMaxSoftwareTriangles / most_triangles));
  }
  const int most =
      std::max(1, static_cast<int>(std::min<std::int64_t>(worker.max_side() / (tile.height * pass.samples), by_size)));
  const auto num_cameras = static_cast<int>(cameras.size() - first_camera);
  for (int first = 0; first < num_cameras; first += most) {
    const int count = std::min(most, num_cameras - first);
    task.rounds.push_back(
        {{tile.width, tile.height, roomy(count, most)}, pass, first_camera + static_cast<std::size_t>(first), count});
  }
}

void GlRenderer::Impl::write(const GlRound& round, const AtlasPixels& pixels, Workers& workers) const {
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
