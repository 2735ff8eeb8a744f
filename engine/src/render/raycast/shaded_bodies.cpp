#include "render/raycast/shaded_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "flockstep/body.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"

namespace flockstep::render {

ShadedMesh::ShadedMesh(const BodySurface& surface, const Shading& world)
    : world_(*surface.mesh), shading_(surface.shading), light_(world.light()), tables_(shading_->tables_of_body(world)) {
  for (auto& lit_in : lit_in_) lit_in.resize(tables_.triangles.size());
}

bool ShadedMesh::fits(const BodySurface& surface, const Light& light) const {
  return surface.shading == shading_ && light == light_;
}

void ShadedMesh::turn(const Mat3& to_local) {
  if (!is_turned(to_local)) return;
  to_local_ = to_local;
  const auto turned = [&](const std::array<float, 3>& direction) -> std::array<float, 3> {
    const Vec3 local = trace::rotated(to_local, {direction[0], direction[1], direction[2]});
    return {local.x(), local.y(), local.z()};
  };
  tables_.light.sun_direction = turned(light_.sun_direction);
  tables_.up = turned({0.0F, 0.0F, 1.0F});
  ++generation_;
}

void ShadedMesh::light(std::span<const std::int32_t> triangles, bool shadows) {
  for (const bool shaded : {false, true}) {
    if (shaded && !shadows) break;
    auto& lit_in = lit_in_[shaded ? 1 : 0];
    missing_.clear();
    for (const std::int32_t triangle : triangles) {
      std::uint32_t& generation = lit_in[static_cast<std::size_t>(triangle)];
      if (generation == generation_) continue;
      generation = generation_;
      missing_.push_back(triangle);
    }
    if (!missing_.empty()) shading_->light_triangles(tables_, missing_, shaded);
  }
}

namespace {

constexpr std::size_t kRamps = 16;   // ramps that are kept, unless a frame needs more
constexpr std::size_t kMeshes = 16;  // the same for meshes

// Returns whether a beam from one box can hit another box. half: of both together.
// It can if a ray from the first box's centre along the axis hits the second one, widened by the first and by the spread.
bool reaches(const Casters::Beam& beam, const Vec3& offset, const Vec3& half_of_both) {
  Vec3 half = half_of_both;
  if (beam.spread > 0.0F) half.array() += beam.spread * (offset.norm() + half.norm());  // the second factor: the longest ray
  float enter = 0.0F;
  float leave = std::numeric_limits<float>::max();
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    if (beam.axis[axis] == 0.0F) {
      if (std::abs(offset[axis]) > half[axis]) leave = -1.0F;
      continue;
    }
    const float low = (offset[axis] - half[axis]) / beam.axis[axis];
    const float high = (offset[axis] + half[axis]) / beam.axis[axis];
    enter = std::max(enter, std::min(low, high));
    leave = std::min(leave, std::max(low, high));
  }
  return enter <= leave;
}

// Returns whether two lights give the same ramps.
bool give_same_ramps(const Light& a, const Light& b) {
  return a.sun_color == b.sun_color && a.sky_ambient == b.sky_ambient && a.ground_ambient == b.ground_ambient &&
         a.gamma == b.gamma;
}

}  // namespace

void ShadedBodies::begin(const VisibleBodies& bodies, const VisibleBodies& drones, const Shading& shading) {
  shading_ = &shading;
  bodies_ = bodies;
  drones_ = drones;
  ++frame_;
  if (bodies.shapes.count == 0) return;
  if (shaded_.size() < bodies.shapes.count) shaded_.resize(bodies.shapes.count);
  while (ramps_.size() < kRamps) ramps_.push_back(std::make_unique<Ramp>());
}

void ShadedBodies::shade(std::size_t number, Body& body) {
  const BodySurface& surface = bodies_.surface(number);
  body.shape = trace::make_shape(trace::posed_solid(bodies_.shapes, number));
  body.solid = shading_->make_solid(body.shape,
                                    {.color = surface.color, .semantic = surface.semantic, .instance = bodies_.instance(number)});
  if (takes_ramp(body.solid)) body.solid.ramp = find_ramp(body.solid.surface);
  body.frame = frame_;
}

ShadedBodies::Mesh ShadedBodies::mesh_at(std::size_t number) {
  const VisibleBodies& set = of(number);
  const std::size_t among = number_among(number);
  const BodySurface& surface = set.surface(among);
  const trace::PosedMesh posed = trace::posed_mesh(set.shapes, among);
  // The best is one that already has this rotation, then one whose rotation is not needed in this frame.
  const auto rank = [&](const KeptMesh& kept) {
    if (!kept.shaded->fits(surface, shading_->light())) return 0;
    return !kept.shaded->is_turned(posed.to_local) ? 2 : kept.frame != frame_ ? 1 : 0;
  };
  auto found =
      std::max_element(meshes_.begin(), meshes_.end(), [&](const KeptMesh& a, const KeptMesh& b) { return rank(a) < rank(b); });
  if (found == meshes_.end() || rank(*found) == 0) {
    found =
        std::min_element(meshes_.begin(), meshes_.end(), [](const KeptMesh& a, const KeptMesh& b) { return a.frame < b.frame; });
    if (meshes_.size() < kMeshes || found->frame == frame_) found = meshes_.emplace(meshes_.end());
    found->shaded = std::make_unique<ShadedMesh>(surface, *shading_);
  }
  found->shaded->turn(posed.to_local);
  found->frame = frame_;
  return {found->shaded.get(), posed, {.semantic = surface.semantic, .instance = set.instance(among)}};
}

void ShadedBodies::light(const Mesh& mesh, std::int32_t element, const trace::RayBundle& rays, const trace::HitDetails& details,
                         bool shadows) {
  triangles_.clear();
  for (std::size_t i = 0; i < rays.count; ++i) {
    if (rays.element[i] == element) triangles_.push_back(details.triangle[i]);
  }
  mesh.shaded->light(triangles_, shadows);
}

const std::int32_t* ShadedBodies::find_ramp(const Surface& surface) {
  const auto fits = [&](const std::unique_ptr<Ramp>& ramp) {
    return ramp->frame != 0 && ramp->color == surface.color && give_same_ramps(ramp->light, shading_->light());
  };
  auto found = std::find_if(ramps_.begin(), ramps_.end(), fits);
  if (found == ramps_.end()) {
    found = std::min_element(ramps_.begin(), ramps_.end(), [](const auto& a, const auto& b) { return a->frame < b->frame; });
    // A ramp that this frame uses cannot be replaced.
    if ((*found)->frame == frame_) found = ramps_.insert(ramps_.end(), std::make_unique<Ramp>());
    Ramp& ramp = **found;
    ramp.color = surface.color;
    ramp.light = shading_->light();
    shading_->make_ramp(surface, ramp.entries);
    ramp.is_fine = is_fine(ramp.entries);
  }
  (*found)->frame = frame_;
  return (*found)->is_fine ? (*found)->entries.data() : nullptr;
}

void Casters::begin(const trace::Shape* room, std::span<const trace::NumberedShape> primitives, const trace::Bodies& bodies,
                    const trace::Bodies& drones) {
  room_ = room;
  lists_primitives_ = primitives.size() <= kMaxListed;
  casters_.clear();
  if (lists_primitives_) casters_.assign(primitives.begin(), primitives.end());
  meshes_.clear();
  trace::append_shapes(bodies, casters_);
  trace::append_meshes(bodies, meshes_);
  trace::append_meshes(drones, meshes_);
  above_.reserve(casters_.size() + 1);
  meshes_above_.reserve(meshes_.size());
}

std::span<const trace::NumberedShape> Casters::above(const Aabb& box, const Beam& beam) {
  above_.clear();
  if (room_ != nullptr && beam.axis.isZero(0.0F)) above_.push_back({*room_, 0});
  const Vec3 center = 0.5F * (box.min + box.max), half = 0.5F * (box.max - box.min);
  for (const trace::NumberedShape& caster : casters_) {
    if (reaches(beam, caster.shape.box_center - center, caster.shape.box_half + half)) above_.push_back(caster);
  }
  return above_;
}

std::span<const trace::PosedMesh> Casters::meshes_above(const Aabb& box, const Beam& beam) {
  meshes_above_.clear();
  const Vec3 center = 0.5F * (box.min + box.max), half = 0.5F * (box.max - box.min);
  for (const trace::PosedMesh& mesh : meshes_) {
    const Vec3 reach = Vec3::Constant(mesh.radius * 1.0001F + 1e-5F * (1.0F + mesh.position.cwiseAbs().maxCoeff()));
    if (reaches(beam, mesh.position - center, reach + half)) meshes_above_.push_back(mesh);
  }
  return meshes_above_;
}

}  // namespace flockstep::render
