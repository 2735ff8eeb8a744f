#include "render/gl/painter.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "base/srgb.hpp"

namespace flockstep::render {
namespace {

using Vec3d = Eigen::Vector3d;

constexpr std::size_t kMaxBoxes = 4096;  // per draw call, so that indices fit into 16 bits

// Returns the index pattern of a shape with this number of corners, repeated for many copies.
GlBuffer pattern(std::span<const std::uint16_t> indices, std::uint16_t corners, std::size_t copies) {
  std::vector<std::uint16_t> all;
  for (std::size_t copy = 0; copy < copies; ++copy) {
    for (const std::uint16_t index : indices) all.push_back(static_cast<std::uint16_t>(copy * corners + index));
  }
  GlBuffer buffer = GlBuffer::make();
  glNamedBufferStorage(buffer.name(), static_cast<GLsizeiptr>(all.size() * sizeof(all[0])), all.data(), 0);
  return buffer;
}

// Restricts drawing to these attachments.
void write_only(const Attachments& attachments) {
  const auto allow = [](GLuint i, bool allowed) {
    const GLboolean yes = allowed ? GL_TRUE : GL_FALSE;
    glColorMaski(i, yes, yes, yes, yes);
  };
  allow(0, attachments.color);
  allow(1, attachments.ids);
  allow(2, attachments.normal);
}

constexpr Attachments kColor{.color = true};

// The corners of a box are numbered by the bits of x, y and z. Faces are counter-clockwise seen from outside.
constexpr std::array<std::uint16_t, 36> kBox{0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4,
                                             2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2, 1, 3, 7, 1, 7, 5};
constexpr std::array<std::uint16_t, 6> kQuad{0, 1, 3, 0, 3, 2};

template <class T>
void upload(const GlBuffer& buffer, std::span<const T> elements) {
  glNamedBufferData(buffer.name(), static_cast<GLsizeiptr>(elements.size_bytes()), elements.data(), GL_STREAM_DRAW);
}

std::array<float, 4> row(const Vec3d& v, double w = 0.0) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z()), static_cast<float>(w)};
}

std::array<float, 4> row(const std::array<float, 3>& v, float w) { return {v[0], v[1], v[2], w}; }

// Returns whether the eye is far enough from the shape that a rectangle covers all of it and lies beyond the near plane.
bool is_well_outside(const RoundBound& bound, RoundKind kind, const TileCamera& camera, float near_m) {
  if (kind == RoundKind::disc) return true;  // a disc lies in its rectangle
  if (kind == RoundKind::box) return false;  // it has no rectangle
  const Vec3 center = bound.center - camera.position;
  const float pixel = 1.0F / std::min(camera.fx, camera.fy);
  const float radius = 1.001F * bound.radius + 0.06F * pixel * (center.norm() + bound.reach);
  const float distance = (kind == RoundKind::sphere ? center : Vec3(center - center.dot(bound.axis) * bound.axis)).norm();
  return distance > 1.2F * radius + near_m;
}

template <class Planes>
bool is_hidden(const RoundBound& bound, const Planes& frustum) {
  return std::any_of(frustum.begin(), frustum.end(),
                     [&](const auto& plane) { return plane.normal.dot(bound.center) + plane.offset < -bound.reach; });
}

}  // namespace

GlPainter::GlPainter()
    : flat_array_(GlVertexArray::make()),
      box_array_(GlVertexArray::make()),
      quad_array_(GlVertexArray::make()),
      no_array_(GlVertexArray::make()),
      boxes_(pattern(kBox, 8, kMaxBoxes)),
      quads_(pattern(kQuad, 4, kMaxBoxes)),
      cameras_{GlBuffer::make(), GlBuffer::make()},
      commands_(GlBuffer::make()),
      visible_buffer_(GlBuffer::make()),
      body_buffer_(GlBuffer::make()),
      body_casters_(GlBuffer::make()),
      posed_buffer_(GlBuffer::make()) {
  glVertexArrayElementBuffer(box_array_.name(), boxes_.name());
  glVertexArrayElementBuffer(quad_array_.name(), quads_.name());

  constexpr GLuint kVertices = 0;  // buffer bindings
  constexpr GLuint kCameras = 1;
  const GLuint array = flat_array_.name();
  const auto at = [&](GLuint location, GLuint binding) {
    glEnableVertexArrayAttrib(array, location);
    glVertexArrayAttribBinding(array, location, binding);
  };
  glVertexArrayAttribFormat(array, 0, 3, GL_FLOAT, GL_FALSE, offsetof(FlatVertex, position));
  glVertexArrayAttribFormat(array, 1, 3, GL_FLOAT, GL_FALSE, offsetof(FlatVertex, normal));
  glVertexArrayAttribIFormat(array, 2, 2, GL_UNSIGNED_INT, offsetof(FlatVertex, sunlit));
  glVertexArrayAttribIFormat(array, 3, 2, GL_UNSIGNED_INT, offsetof(FlatVertex, shadowy));
  glVertexArrayAttribIFormat(array, 4, 1, GL_UNSIGNED_INT, offsetof(FlatVertex, ids));
  for (GLuint location = 0; location < 5; ++location) at(location, kVertices);
  constexpr GLuint kRow = sizeof(CameraRecord::eye_offset);
  for (GLuint i = 0; i < 7; ++i) {
    glVertexArrayAttribFormat(array, 5 + i, 4, GL_FLOAT, GL_FALSE, i * kRow);
    at(5 + i, kCameras);
  }
  glVertexArrayBindingDivisor(array, kCameras, 1);
  constexpr GLuint kPainted = 2;
  glVertexArrayAttribFormat(array, 12, 2, GL_FLOAT, GL_FALSE, offsetof(PaintedVertex, uv));
  glVertexArrayAttribFormat(array, 13, 1, GL_FLOAT, GL_FALSE, offsetof(PaintedVertex, density));
  glVertexArrayAttribIFormat(array, 14, 1, GL_UNSIGNED_INT, offsetof(PaintedVertex, paint));
  glVertexArrayAttribFormat(array, 15, 3, GL_FLOAT, GL_FALSE, offsetof(PaintedVertex, color));
  for (GLuint location = 12; location < 16; ++location) glVertexArrayAttribBinding(array, location, kPainted);

  glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
  glFrontFace(GL_CW);  // images are upside down: row 0, the top, has the lowest y in OpenGL
  glProvokingVertex(GL_LAST_VERTEX_CONVENTION);
  glDisable(GL_DITHER);
}

void GlPainter::add(const GlModel& model) {
  UploadedModel uploaded;
  const std::size_t first_vertex = vertices_.append(std::span(model.vertices));
  uploaded.first_vertex = static_cast<GLint>(first_vertex);
  uploaded.is_painted = !model.painted.empty();
  uploaded.is_masked = model.masked;
  if (uploaded.is_painted) add_paints(model, first_vertex);
  const std::size_t first_index = indices_.append(std::span(model.indices));
  uploaded.chunks = model.chunks;
  for (FlatChunk& chunk : uploaded.chunks) chunk.first_index += static_cast<std::uint32_t>(first_index);
  for (std::size_t kind = 0; kind < kNumRoundKinds; ++kind) {
    uploaded.first_shape[kind] = static_cast<std::uint32_t>(shapes_[kind].append(std::span(model.shapes[kind])));
  }
  uploaded.bounds = model.bounds;
  uploaded.rooms = model.rooms;
  uploaded.light = model.light;
  uploaded.sun_disc = SunDisc(model.light);
  models_.push_back(std::move(uploaded));
}

void GlPainter::forget_models() {
  models_.clear();
  const auto clear = [](auto&... stores) { (stores.clear(), ...); };
  clear(vertices_, painted_, paints_, texels_, textures_, indices_, grids_, starts_, entries_, casters_, nodes_);
  for (auto& shapes : shapes_) shapes.clear();
}

void GlPainter::add_paints(const GlModel& model, std::size_t first_vertex) {
  const Textures& textures = model.textures;
  if (texels_.size() == 0) {
    const auto& linear = srgb_to_linear();
    std::vector<std::uint32_t> bits;
    for (const float value : linear) bits.push_back(std::bit_cast<std::uint32_t>(value));
    texels_.append(std::span<const std::uint32_t>(bits));
  }
  const std::size_t first_texel = texels_.append(std::span(textures.texels));
  const std::size_t first_texture = textures_.size();
  const std::size_t first_level = first_texture + textures.first_level.size();
  std::vector<std::array<std::uint32_t, 4>> records;
  const auto number = [](std::int32_t value) { return static_cast<std::uint32_t>(value); };
  for (std::size_t i = 0; i < textures.first_level.size(); ++i) {
    records.push_back({static_cast<std::uint32_t>(first_level) + number(textures.first_level[i]), number(textures.num_levels[i]),
                       number(textures.wrap_across[i]), number(textures.wrap_down[i])});
  }
  for (std::size_t i = 0; i < textures.offset.size(); ++i) {
    records.push_back({static_cast<std::uint32_t>(first_texel) + number(textures.offset[i]), number(textures.width[i]),
                       number(textures.height[i]), 0});
  }
  textures_.append(std::span<const std::array<std::uint32_t, 4>>(records));
  std::vector<Paint> paints = model.paints;
  for (Paint& paint : paints) {
    if (paint.texture > 0.0F) paint.texture += static_cast<float>(first_texture);
  }
  const auto first_paint = static_cast<std::uint32_t>(paints_.append(std::span<const Paint>(paints)));
  std::vector<PaintedVertex> vertices(first_vertex - painted_.size());  // for earlier models without paints
  for (PaintedVertex vertex : model.painted) {
    if (vertex.paint != 0) vertex.paint += first_paint;
    vertices.push_back(vertex);
  }
  painted_.append(std::span<const PaintedVertex>(vertices));
}

std::uint32_t GlPainter::add_masks(const SunMasks& masks) {
  const auto first_alpha = static_cast<std::uint32_t>(entries_.append(std::span<const std::uint32_t>(masks.alphas)));
  std::vector<SunCaster> casters = masks.masks;
  for (SunCaster& mask : casters) mask.begin_alphas(first_alpha);
  return static_cast<std::uint32_t>(casters_.append(std::span<const SunCaster>(casters)));
}

void GlPainter::add(std::uint32_t model, const GlSunGrid& grid) {
  const auto first_caster = static_cast<std::uint32_t>(casters_.append(std::span(grid.casters)));
  std::vector<std::uint32_t> entries = grid.entries;
  for (std::uint32_t& entry : entries) entry += first_caster;
  const auto first_entry = static_cast<std::uint32_t>(entries_.append(std::span<const std::uint32_t>(entries)));
  const std::uint32_t first_mask = add_masks(grid.masks);
  std::vector<std::uint32_t> starts = grid.starts;
  for (std::uint32_t& start : starts) start += first_entry;
  const auto first_start = static_cast<std::uint32_t>(starts_.append(std::span<const std::uint32_t>(starts)));
  GridRecord record{};
  for (Eigen::Index i = 0; i < 3; ++i) record.to_sun[static_cast<std::size_t>(i)] = row(grid.to_sun.col(i).cast<double>());
  record.left_low_cell = {grid.left, grid.low, grid.cell, 1.0F / grid.cell};
  record.size = {grid.columns, grid.rows, first_start, first_mask};
  models_[model].grid = static_cast<std::uint32_t>(grids_.append(std::span<const GridRecord>(&record, 1)));
}

void GlPainter::add(std::uint32_t model, const GlCasterTree& tree) {
  if (tree.nodes.empty()) return;
  const std::uint32_t first_mask = add_masks(tree.masks);
  std::vector<SunCaster> triangles = tree.triangles;
  for (SunCaster& triangle : triangles) {
    if (triangle.rows[0][3] > 0.0F) triangle.rows[0][3] += static_cast<float>(first_mask);
  }
  const auto first_triangle = static_cast<std::uint32_t>(casters_.append(std::span<const SunCaster>(triangles)));
  const auto first_node = static_cast<std::uint32_t>(nodes_.size());
  std::vector<CasterNode> nodes = tree.nodes;
  for (CasterNode& node : nodes) {
    node.next += first_node;
    if (node.triangles != 0) node.triangles += first_triangle << 3U;
  }
  nodes_.append(std::span<const CasterNode>(nodes));
  models_[model].nodes = first_node;
}

void GlPainter::paint(const GlAtlas& atlas, std::span<const TileCamera> cameras, const GlBodies& bodies, const GlPass& pass) {
  records_.clear();
  painted_last_ = 1 - painted_last_;
  posed_cameras_.clear();
  posed_.clear();
  flat_commands_.clear();
  posed_commands_.clear();
  for (auto* const shapes : {&visible_, &visible_bodies_}) {
    for (VisibleShapes& of_kind : *shapes) {
      for (auto& visible : of_kind) visible.clear();
    }
  }
  for (auto& shapes : body_shapes_) shapes.clear();
  caster_lists_.assign(1, SunCaster{});
  sky_cameras_.clear();
  meshes_cast_ = false;
  for (std::size_t i = 0; i < cameras.size(); ++i)
    cull(cameras[i], cameras.size(), static_cast<std::uint32_t>(i), bodies, atlas, pass);
  records_.insert(records_.end(), posed_cameras_.begin(), posed_cameras_.end());
  upload(camera_buffer(), std::span<const CameraRecord>(records_));

  // Attachments need clearing only if a pixel may remain unwritten. If colours are drawn, the sky fills every uncovered
  // pixel. If the sky is invisible to all cameras, every pixel is covered.
  const Attachments& writes = pass.traits.writes;
  write_only(writes);
  glDepthMask(GL_TRUE);
  atlas.clear(writes.color || sky_cameras_.empty() ? Attachments{} : writes);
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, atlas.framebuffer());
  const AtlasSize& size = atlas.size();
  glViewport(0, 0, size.width, size.height * size.tiles);
  glEnable(GL_DEPTH_TEST);
  glEnable(GL_CLIP_DISTANCE0);
  glEnable(GL_CLIP_DISTANCE1);
  glDepthFunc(GL_GREATER);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kCamerasBinding, camera_buffer().name());
  if (pass.traits.shadows) {
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kGridsBinding, grids_.name());
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kStartsBinding, starts_.name());
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kEntriesBinding, entries_.name());
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kCastersBinding, casters_.name());
  }
  ShaderTraits traits = pass.traits;
  traits.bodies = caster_lists_.size() > 1;
  if (traits.bodies) {
    upload(body_casters_, std::span<const SunCaster>(caster_lists_));
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kBodyCastersBinding, body_casters_.name());
  }
  traits.meshes = meshes_cast_;
  if (traits.meshes) glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kCasterNodesBinding, nodes_.name());
  const auto use = [&](GLuint program) {
    glUseProgram(program);
    const auto tile_height = static_cast<float>(size.height);
    glUniform4f(kTilesUniform, tile_height, 1.0F / tile_height, 1.0F / static_cast<float>(size.tiles), 0.0F);
    glUniform4f(kRangeUniform, pass.near_m, pass.far_m, 1.0F / pass.far_m, 1.0F / (1.0F / pass.near_m - 1.0F / pass.far_m));
  };
  traits.air =
      std::any_of(cameras.begin(), cameras.end(), [&](const TileCamera& c) { return !Air(models_[c.model].light).is_clear(); });
  const auto shows_masks = [&](const TileCamera& c) { return models_[c.model].is_masked; };
  const bool masked_worlds = std::any_of(cameras.begin(), cameras.end(), shows_masks);
  const bool masked_meshes = std::any_of(cameras.begin(), cameras.end(), [&](const TileCamera& c) {
    const auto meshes = std::span(bodies.meshes).subspan(c.first_mesh, c.num_meshes);
    return std::any_of(meshes.begin(), meshes.end(), [&](const GlMeshBody& mesh) { return models_[mesh.model].is_masked; });
  });
  traits.masked = masked_worlds || (masked_meshes && traits.shadows);
  if (!flat_commands_.empty()) {
    traits.painted =
        std::any_of(cameras.begin(), cameras.end(), [&](const TileCamera& c) { return models_[c.model].is_painted; });
    use(shaders_.flat(traits));
    draw_flat(flat_commands_, traits.painted);
  }
  if (!posed_commands_.empty()) {
    ShaderTraits of_meshes = traits;
    of_meshes.masked = masked_meshes || (masked_worlds && traits.shadows);
    upload(posed_buffer_, std::span<const PosedRecord>(posed_));
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kPosedMeshesBinding, posed_buffer_.name());
    use(shaders_.posed(of_meshes));
    draw_flat(posed_commands_, true);
  }
  for (std::size_t kind = 0; kind < kNumRoundKinds; ++kind) {
    const auto draw = [&](const VisibleShapes& visible, GLuint shapes) {
      for (const bool boxes : {false, true}) {
        if (visible[boxes ? 1 : 0].empty()) continue;
        use(shaders_.round(static_cast<RoundKind>(kind), traits));
        draw_round(visible, boxes, shapes);
      }
    };
    draw(visible_[kind], shapes_[kind].name());
    if (body_shapes_[kind].empty()) continue;
    upload(body_buffer_, std::span<const RoundShape>(body_shapes_[kind]));
    draw(visible_bodies_[kind], body_buffer_.name());
  }
  if (writes.color && !sky_cameras_.empty()) {
    traits.sun = std::any_of(sky_cameras_.begin(), sky_cameras_.end(),
                             [&](std::uint32_t i) { return models_[cameras[i].model].sun_disc.shows; });
    use(shaders_.sky(traits));
    draw_sky();
  }
}

// Returns the first caster of the camera's list, and adds the list unless the previous camera has the same one.
std::uint32_t GlPainter::list_casters(const TileCamera& camera, const GlBodies& bodies) {
  if (camera.num_bodies == 0 && camera.num_meshes == 0) return 0;
  if (listed_body_ != camera.first_body || listed_mesh_ != camera.first_mesh || listed_without_ != camera.hidden_ids ||
      caster_lists_.size() == 1) {
    listed_body_ = camera.first_body;
    listed_mesh_ = camera.first_mesh;
    listed_without_ = camera.hidden_ids;
    last_list_ = static_cast<std::uint32_t>(caster_lists_.size());
    for (const GlBody& body : std::span(bodies.solids).subspan(camera.first_body, camera.num_bodies)) {
      caster_lists_.push_back(body.caster);
    }
    for (const GlMeshBody& mesh : std::span(bodies.meshes).subspan(camera.first_mesh, camera.num_meshes)) {
      const std::optional<std::uint32_t>& nodes = models_[mesh.model].nodes;
      if (!nodes || !camera.shows(mesh)) continue;
      caster_lists_.push_back(mesh.caster);
      caster_lists_.back().begin_nodes(*nodes);
      meshes_cast_ = true;
    }
    caster_lists_.emplace_back();
  }
  return last_list_;
}

GlPainter::View GlPainter::View::in_frame_of(const GlMeshBody& body) const {
  const Eigen::Matrix3d to_local = body.rotation.cast<double>().transpose();
  const auto turned = [&](const Vec3d& v) -> Vec3d { return to_local * v; };
  return {
      turned(eye - body.position.cast<double>()), turned(w), turned(x), turned(y), turned(ray_0), turned(ray_u), turned(ray_v)};
}

GlPainter::Frustum GlPainter::View::frustum(const GlPass& pass) const {
  Frustum frustum;
  const auto plane = [&](std::size_t i, const Vec3d& normal, double distance) {
    frustum[i] = {normal.normalized().cast<float>(),
                  static_cast<float>(-normal.dot(eye) - distance) / static_cast<float>(normal.norm())};
  };
  plane(0, w - x, 0.0);
  plane(1, w + x, 0.0);
  plane(2, w - y, 0.0);
  plane(3, w + y, 0.0);
  plane(4, w, static_cast<double>(pass.near_m));
  plane(5, -w, -static_cast<double>(pass.far_m));
  return frustum;
}

void GlPainter::cull(const TileCamera& camera, std::size_t num_cameras, std::uint32_t number, const GlBodies& bodies,
                     const GlAtlas& atlas, const GlPass& pass) {
  const UploadedModel& model = models_[camera.model];
  const AtlasSize& size = atlas.size();
  const Eigen::Matrix3d rotation = camera.rotation.cast<double>();
  const Vec3d forward = rotation.col(0);
  const Vec3d left = rotation.col(1);
  const Vec3d up = rotation.col(2);
  const double samples = pass.samples;
  const double fx = static_cast<double>(camera.fx) * samples;
  const double fy = static_cast<double>(camera.fy) * samples;
  const double cx = static_cast<double>(camera.cx) * samples;
  const double cy = static_cast<double>(camera.cy) * samples;
  const double width = size.width;
  const double height = size.height;
  // Maps u = cx - fx y / x and v = cy - fy z / x to [-1, 1] over the tile.
  const View view{.eye = camera.position.cast<double>(),
                  .w = forward,
                  .x = (2.0 * cx / width - 1.0) * forward - 2.0 * fx / width * left,
                  .y = (2.0 * cy / height - 1.0) * forward - 2.0 * fy / height * up,
                  .ray_0 = forward + cx / fx * left + cy / fy * up,
                  .ray_u = -left / fx,
                  .ray_v = -up / fy};
  const double middle = (2.0 * number + 1.0) / size.tiles - 1.0;
  const float gamma_exponent = 1.0F / model.light.gamma;
  const auto record_of = [&](const View& v, double ray_u_w, double ray_v_w) -> CameraRecord {
    return {row(v.eye, middle),
            row(v.w, cx),
            row(v.x, cy),
            row(v.y, 1.0 / fx),
            row(v.ray_0, 1.0 / fy),
            row(v.ray_u, ray_u_w),
            row(v.ray_v, ray_v_w),
            row(model.light.horizon_color, gamma_exponent),
            row(model.light.zenith_color, model.sun_disc.glow),
            row(model.light.sun_direction, model.sun_disc.edge),
            row(model.sun_disc.color, model.sun_disc.steepness),
            Air(model.light).row()};
  };
  const std::uint32_t casters = pass.traits.shadows ? list_casters(camera, bodies) : 0;
  records_.push_back(record_of(view, casters, model.grid));

  const Frustum frustum = view.frustum(pass);
  cull_flat(model, frustum, number, flat_commands_);
  cull_round(model, frustum, camera, pass, number);
  cull_bodies(std::span(bodies.solids).subspan(camera.first_body, camera.num_bodies), frustum, camera, pass, number);
  for (const GlMeshBody& mesh : std::span(bodies.meshes).subspan(camera.first_mesh, camera.num_meshes)) {
    if (!camera.shows(mesh) || is_hidden(RoundBound{mesh.position, Vec3::UnitZ(), mesh.radius, mesh.radius}, frustum)) continue;
    const View local = view.in_frame_of(mesh);
    const auto record = static_cast<std::uint32_t>(num_cameras + posed_.size());
    posed_cameras_.push_back(record_of(local, static_cast<double>(posed_.size()), 0.0));
    posed_.push_back(posed_record(mesh, number, model.light));
    cull_flat(models_[mesh.model], local.frustum(pass), record, posed_commands_);
  }

  // A camera shows no sky if it is inside a room, the near plane is too far from the walls to cut through one, and the far
  // plane lies beyond the room.
  const double near = static_cast<double>(pass.near_m);
  const double far = static_cast<double>(pass.far_m);
  double corner = 0.0;
  for (const double u : {0.0, width}) {
    for (const double v : {0.0, height}) corner = std::max(corner, (view.ray_0 + u * view.ray_u + v * view.ray_v).norm());
  }
  const bool is_indoors = std::any_of(model.rooms.begin(), model.rooms.end(), [&](const Aabb& room) {
    const Vec3d low = room.min.cast<double>();
    const Vec3d high = room.max.cast<double>();
    const double margin = std::min((view.eye - low).minCoeff(), (high - view.eye).minCoeff());
    const Vec3d farthest = (forward.array() > 0.0).select(high, low) - view.eye;
    return margin > 1.001 * near * corner && forward.dot(farthest) < 0.999 * far;
  });
  if (!is_indoors) sky_cameras_.push_back(number);
}

GlPainter::PosedRecord GlPainter::posed_record(const GlMeshBody& mesh, std::uint32_t camera, const Light& light) {
  PosedRecord record{.camera = camera, .ids = mesh.ids, .gamma_exponent = 1.0F / light.gamma};
  const auto axis = [&](Eigen::Index i) -> std::array<float, 3> {
    return {mesh.rotation(0, i), mesh.rotation(1, i), mesh.rotation(2, i)};
  };
  record.axis_x = axis(0);
  record.axis_y = axis(1);
  record.axis_z = axis(2);
  for (std::size_t i = 0; i < 3; ++i) {
    record.middle[i] = 0.5F * (light.sky_ambient[i] + light.ground_ambient[i]);
    record.slope[i] = 0.5F * (light.sky_ambient[i] - light.ground_ambient[i]);
  }
  record.sun = row(light.sun_color, 0.0F);
  record.sun_direction = row(light.sun_direction, 0.0F);
  return record;
}

// number: of the camera's record.
void GlPainter::cull_flat(const UploadedModel& model, const Frustum& frustum, std::uint32_t number,
                          std::vector<DrawCommand>& commands) {
  const bool all = model.chunks.size() == 1;
  for (const FlatChunk& chunk : model.chunks) {
    const bool hidden = !all && std::any_of(frustum.begin(), frustum.end(), [&](const Plane& plane) {
      return plane.normal.dot(chunk.center) + plane.normal.cwiseAbs().dot(chunk.half) + plane.offset < 0.0F;
    });
    if (hidden) continue;
    if (!commands.empty() && commands.back().base_instance == number) {
      DrawCommand& last = commands.back();
      if (last.first_index + last.count == chunk.first_index) {
        last.count += chunk.index_count;
        continue;
      }
    }
    commands.push_back({chunk.index_count, 1, chunk.first_index, model.first_vertex, number});
  }
}

void GlPainter::cull_round(const UploadedModel& model, const Frustum& frustum, const TileCamera& camera, const GlPass& pass,
                           std::uint32_t number) {
  for (std::size_t kind = 0; kind < kNumRoundKinds; ++kind) {
    for (std::size_t i = 0; i < model.bounds[kind].size(); ++i) {
      const RoundBound& bound = model.bounds[kind][i];
      if (is_hidden(bound, frustum)) continue;
      const bool boxes = !is_well_outside(bound, static_cast<RoundKind>(kind), camera, pass.near_m);
      visible_[kind][boxes ? 1 : 0].push_back({number, model.first_shape[kind] + static_cast<std::uint32_t>(i)});
    }
  }
}

void GlPainter::cull_bodies(std::span<const GlBody> bodies, const Frustum& frustum, const TileCamera& camera, const GlPass& pass,
                            std::uint32_t number) {
  for (const GlBody& body : bodies) {
    if (is_hidden(body.bound, frustum)) continue;
    const auto kind = static_cast<std::size_t>(body.kind);
    const bool boxes = !is_well_outside(body.bound, body.kind, camera, pass.near_m);
    visible_bodies_[kind][boxes ? 1 : 0].push_back({number, static_cast<std::uint32_t>(body_shapes_[kind].size())});
    body_shapes_[kind].push_back(body.shape);
  }
}

void GlPainter::draw_flat(const std::vector<DrawCommand>& commands, bool painted) {
  glDisable(GL_CULL_FACE);
  glBindVertexArray(flat_array_.name());
  glVertexArrayVertexBuffer(flat_array_.name(), 0, vertices_.name(), 0, sizeof(FlatVertex));
  glVertexArrayVertexBuffer(flat_array_.name(), 1, camera_buffer().name(), 0, sizeof(CameraRecord));
  glVertexArrayElementBuffer(flat_array_.name(), indices_.name());
  if (painted) {
    // Models added after the last painted one lack these vertices.
    if (painted_.size() < vertices_.size()) {
      painted_.append(std::span<const PaintedVertex>(std::vector<PaintedVertex>(vertices_.size() - painted_.size())));
    }
    glVertexArrayVertexBuffer(flat_array_.name(), 2, painted_.name(), 0, sizeof(PaintedVertex));
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kTexelsBinding, texels_.name());
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kTexturesBinding, textures_.name());
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kPaintsBinding, paints_.name());
  }
  for (GLuint location = 12; location < 16; ++location) {
    (painted ? glEnableVertexArrayAttrib : glDisableVertexArrayAttrib)(flat_array_.name(), location);
  }
  upload(commands_, std::span<const DrawCommand>(commands));
  glBindBuffer(GL_DRAW_INDIRECT_BUFFER, commands_.name());
  glMultiDrawElementsIndirect(GL_TRIANGLES, GL_UNSIGNED_INT, nullptr, static_cast<GLsizei>(commands.size()), 0);
}

void GlPainter::draw_round(const VisibleShapes& shown, bool boxes, GLuint shapes) {
  const std::vector<VisibleShape>& visible = shown[boxes ? 1 : 0];
  if (boxes) {
    glEnable(GL_CULL_FACE);
    glCullFace(GL_FRONT);
  } else {
    glDisable(GL_CULL_FACE);
  }
  glUniform1i(kBoxesUniform, boxes ? 1 : 0);
  glBindVertexArray(boxes ? box_array_.name() : quad_array_.name());
  upload(visible_buffer_, std::span<const VisibleShape>(visible));
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kVisibleBinding, visible_buffer_.name());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kShapesBinding, shapes);
  const std::size_t indices = boxes ? kBox.size() : kQuad.size();
  for (std::size_t first = 0; first < visible.size(); first += kMaxBoxes) {
    const std::size_t count = std::min(kMaxBoxes, visible.size() - first);
    glDrawElementsBaseVertex(GL_TRIANGLES, static_cast<GLsizei>(indices * count), GL_UNSIGNED_SHORT, nullptr,
                             static_cast<GLint>((boxes ? 8 : 4) * first));
  }
}

void GlPainter::draw_sky() {
  glDisable(GL_CULL_FACE);
  glDepthFunc(GL_EQUAL);
  glDepthMask(GL_FALSE);
  glBindVertexArray(quad_array_.name());
  for (std::size_t first = 0; first < sky_cameras_.size();) {
    std::size_t count = 1;
    while (first + count < sky_cameras_.size() && sky_cameras_[first + count] == sky_cameras_[first] + count &&
           count < kMaxBoxes) {
      ++count;
    }
    glDrawElementsBaseVertex(GL_TRIANGLES, static_cast<GLsizei>(kQuad.size() * count), GL_UNSIGNED_SHORT, nullptr,
                             static_cast<GLint>(4 * sky_cameras_[first]));
    first += count;
  }
}

void GlPainter::resolve(const GlAtlas& samples, const GlAtlas& into, int side, int tiles) {
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, into.framebuffer());
  glViewport(0, 0, into.size().width, into.size().height * tiles);
  glDisable(GL_DEPTH_TEST);
  glDisable(GL_CLIP_DISTANCE0);
  glDisable(GL_CLIP_DISTANCE1);
  glDisable(GL_CULL_FACE);
  write_only(kColor);
  glUseProgram(shaders_.resolve());
  glUniform1i(kSamplesUniform, side);
  glBindTextureUnit(0, samples.color());
  glBindVertexArray(no_array_.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
}

}  // namespace flockstep::render
