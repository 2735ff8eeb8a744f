#include "render/gl/painter.hpp"

#include <bit>
#include <cmath>

#include "base/srgb.hpp"

namespace flockstep::render {
namespace {

using Vec3d = Eigen::Vector3d;

template <class T>
void upload(const GlObject& buffer, const std::vector<T>& elements) {
  glNamedBufferData(buffer.name(), static_cast<GLsizeiptr>(elements.size() * sizeof(T)), elements.data(), GL_STREAM_DRAW);
}

std::array<float, 4> row(const Vec3d& v, double w = 0.0) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z()), static_cast<float>(w)};
}

std::array<float, 4> row(const std::array<float, 3>& v, float w = 0.0F) { return {v[0], v[1], v[2], w}; }

}  // namespace

// In double precision. The names are those of GlView.
struct GlPainter::Eye {
  Vec3d eye, w, x, y, ray_0, ray_u, ray_v;

  // Maps u = cx - fx y / x and v = cy - fy z / x to [-1, 1] over the tile.
  static Eye of(const TileCamera& camera, const AtlasSize& size, double samples) {
    const Eigen::Matrix3d rotation = camera.rotation.cast<double>();
    const Vec3d forward = rotation.col(0), left = rotation.col(1), up = rotation.col(2);
    const double fx = static_cast<double>(camera.fx) * samples, fy = static_cast<double>(camera.fy) * samples;
    const double cx = static_cast<double>(camera.cx) * samples, cy = static_cast<double>(camera.cy) * samples;
    return {.eye = camera.position.cast<double>(),
            .w = forward,
            .x = (2.0 * cx / size.width - 1.0) * forward - 2.0 * fx / size.width * left,
            .y = (2.0 * cy / size.height - 1.0) * forward - 2.0 * fy / size.height * up,
            .ray_0 = forward + cx / fx * left + cy / fy * up,
            .ray_u = -left / fx,
            .ray_v = -up / fy};
  }

  Eye in_frame_of(const GlItem& item) const {
    const Eigen::Matrix3d to_local = item.rotation.cast<double>().transpose();
    return {to_local * (eye - item.position.cast<double>()),
            to_local * w,
            to_local * x,
            to_local * y,
            to_local * ray_0,
            to_local * ray_u,
            to_local * ray_v};
  }

  // Returns true if the camera does not see the box.
  bool misses(const Vec3& center, const Vec3& half, const GlPass& pass) const {
    const Vec3d from_eye = center.cast<double>() - eye;
    const auto is_outside = [&](const Vec3d& normal, double least) {
      return normal.dot(from_eye) + normal.cwiseAbs().dot(half.cast<double>()) < least;
    };
    return is_outside(w - x, 0.0) || is_outside(w + x, 0.0) || is_outside(w - y, 0.0) || is_outside(w + y, 0.0) ||
           is_outside(w, static_cast<double>(pass.near_m)) || is_outside(-w, -static_cast<double>(pass.far_m));
  }

  GlView view(const GlItem& item, const Light& light, double middle) const {
    const Eigen::Matrix3d turn = item.rotation.cast<double>();
    const SunDisc sun(light);
    GlView view{.eye_middle = row(eye, middle),
                .w = row(w),
                .x = row(x),
                .y = row(y),
                .ray_0 = row(ray_0),
                .ray_u = row(ray_u),
                .ray_v = row(ray_v),
                .turn_x = row(turn.col(0)),
                .turn_y = row(turn.col(1)),
                .turn_z = row(turn.col(2)),
                .scale = item.scale,
                .color = item.color,
                .ids = item.ids,
                .sun = row(light.sun_color),
                .sun_direction = row(light.sun_direction),
                .horizon = row(light.horizon_color),
                .zenith_glow = row(light.zenith_color, sun.glow),
                .disc_steepness = row(sun.color, sun.steepness),
                .edge = sun.edge,
                .first_color = 2 * item.first_color};
    for (std::size_t i = 0; i < 3; ++i) {
      view.middle_gamma[i] = 0.5F * (light.sky_ambient[i] + light.ground_ambient[i]);
      view.slope[i] = 0.5F * (light.sky_ambient[i] - light.ground_ambient[i]);
    }
    view.middle_gamma[3] = 1.0F / light.gamma;
    return view;
  }
};

GlPainter::GlPainter() : array_(make_vertex_array()), no_array_(make_vertex_array()), commands_buffer_(make_buffer()) {
  const auto read = [&](GLuint location, GLuint buffer) {
    glEnableVertexArrayAttrib(array_.name(), location);
    glVertexArrayAttribBinding(array_.name(), location, buffer);
  };
  glVertexArrayAttribFormat(array_.name(), 0, 3, GL_FLOAT, GL_FALSE, offsetof(GlVertex, position));
  glVertexArrayAttribFormat(array_.name(), 1, 2, GL_FLOAT, GL_FALSE, offsetof(GlVertex, uv));
  glVertexArrayAttribFormat(array_.name(), 2, 3, GL_FLOAT, GL_FALSE, offsetof(GlVertex, color));
  glVertexArrayAttribIFormat(array_.name(), 3, 2, GL_UNSIGNED_INT, offsetof(DrawCommand, first_triangle));
  for (GLuint location = 0; location < 3; ++location) read(location, 0);
  read(3, 1);
  glVertexArrayBindingDivisor(array_.name(), 1, 1);

  std::vector<std::uint32_t> linear;
  for (const float value : srgb_to_linear()) linear.push_back(std::bit_cast<std::uint32_t>(value));
  texels_.append(linear);

  glClipControl(GL_LOWER_LEFT, GL_ZERO_TO_ONE);
  glFrontFace(GL_CW);  // images are upside down: row 0, the top, has the lowest y in OpenGL
  glProvokingVertex(GL_LAST_VERTEX_CONVENTION);
  glDepthFunc(GL_GREATER);
  glDisable(GL_DITHER);
}

void GlPainter::add(const GlModel& model) {
  const Textures& textures = model.textures;
  const auto first_texture = static_cast<std::uint32_t>(textures_.size());
  const auto first_level = first_texture + static_cast<std::uint32_t>(textures.first_level.size());
  const std::uint32_t first_texel = texels_.append(textures.texels);
  std::vector<std::array<std::uint32_t, 4>> records;
  const auto number = [](std::int32_t value) { return static_cast<std::uint32_t>(value); };
  for (std::size_t i = 0; i < textures.first_level.size(); ++i) {
    records.push_back({first_level + number(textures.first_level[i]), number(textures.num_levels[i]),
                       number(textures.wrap_across[i]), number(textures.wrap_down[i])});
  }
  for (std::size_t i = 0; i < textures.offset.size(); ++i) {
    records.push_back({first_texel + number(textures.offset[i]), number(textures.width[i]), number(textures.height[i]),
                       number(textures.stride[i])});
  }
  textures_.append(records);

  UploadedModel& uploaded = models_.emplace_back();
  uploaded.first_vertex = static_cast<GLint>(vertices_.append(model.vertices));
  uploaded.chunks = model.chunks;
  uploaded.is_textured = !textures.empty();
  uploaded.is_masked = model.masked;
  const std::uint32_t first_triangle = corners_.append(model.corners);
  for (GlChunk& chunk : uploaded.chunks) chunk.first_triangle += first_triangle;
  std::vector<GlTriangle> triangles = model.triangles;
  for (GlTriangle& triangle : triangles) triangle.texture += triangle.texture > 0 ? first_texture : 0;
  triangles_.append(triangles);
}

void GlPainter::paint(const GlAtlas& atlas, const GlScene& scene, std::span<const TileCamera> cameras, const GlPass& pass) {
  const AtlasSize& size = atlas.size();
  views_.clear();
  for (auto& commands : commands_) commands.clear();
  shows_textures_ = shows_masks_ = false;
  views_.resize(cameras.size());
  for (std::size_t i = 0; i < cameras.size(); ++i) see(cameras[i], static_cast<std::uint32_t>(i), scene, size, pass);

  painted_last_ = 1 - painted_last_;
  const Frame& frame = frames_[painted_last_];
  upload(frame.views, views_);
  upload(frame.colors, scene.colors);
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kViewsBinding, frame.views.name());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kColorsBinding, frame.colors.name());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kTrianglesBinding, triangles_.name());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kTexelsBinding, texels_.name());
  glBindBufferBase(GL_SHADER_STORAGE_BUFFER, kTexturesBinding, textures_.name());

  atlas.clear();
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, atlas.framebuffer());
  const auto use = [&](GlShaders::Role role) {
    glUseProgram(shaders_.get(role, {.writes = pass.writes, .textured = shows_textures_, .masked = shows_masks_}));
    const auto tile_height = static_cast<float>(size.height);
    glUniform4f(kTilesUniform, tile_height, 1.0F / tile_height, 1.0F / static_cast<float>(size.tiles), 0.0F);
    glUniform4f(kRangeUniform, 1.0F / pass.far_m, 1.0F / (1.0F / pass.near_m - 1.0F / pass.far_m), 0.0F, 0.0F);
  };
  if (pass.writes.color) {
    glViewport(0, 0, size.width, size.height * static_cast<GLsizei>(cameras.size()));
    use(GlShaders::Role::sky);
    glBindVertexArray(no_array_.name());
    glDrawArrays(GL_TRIANGLES, 0, 3);
  }

  const std::size_t num_two_sided = commands_[0].size();
  std::vector<DrawCommand>& commands = commands_[0];
  commands.insert(commands.end(), commands_[1].begin(), commands_[1].end());
  if (commands.empty()) return;
  for (std::size_t i = 0; i < commands.size(); ++i) commands[i].base_instance = static_cast<GLuint>(i);
  upload(commands_buffer_, commands);
  glViewport(0, 0, size.width, size.height * size.tiles);
  use(GlShaders::Role::triangles);
  glEnable(GL_DEPTH_TEST);
  glEnable(GL_CLIP_DISTANCE0);
  glEnable(GL_CLIP_DISTANCE1);
  glBindVertexArray(array_.name());
  glVertexArrayVertexBuffer(array_.name(), 0, vertices_.name(), 0, sizeof(GlVertex));
  glVertexArrayVertexBuffer(array_.name(), 1, commands_buffer_.name(), 0, sizeof(DrawCommand));
  glVertexArrayElementBuffer(array_.name(), corners_.name());
  glBindBuffer(GL_DRAW_INDIRECT_BUFFER, commands_buffer_.name());
  const auto draw = [&](std::size_t first, std::size_t count) {
    if (count == 0) return;
    glMultiDrawElementsIndirect(GL_TRIANGLES, GL_UNSIGNED_INT, reinterpret_cast<const void*>(first * sizeof(DrawCommand)),
                                static_cast<GLsizei>(count), sizeof(DrawCommand));
  };
  draw(0, num_two_sided);
  glEnable(GL_CULL_FACE);
  draw(num_two_sided, commands.size() - num_two_sided);
  for (const auto state : {GL_CULL_FACE, GL_DEPTH_TEST, GL_CLIP_DISTANCE0, GL_CLIP_DISTANCE1}) {
    glDisable(static_cast<GLenum>(state));
  }
}

// Adds the views and draw commands of what a camera sees.
void GlPainter::see(const TileCamera& camera, std::uint32_t number, const GlScene& scene, const AtlasSize& size,
                    const GlPass& pass) {
  const double middle = (2.0 * number + 1.0) / size.tiles - 1.0;
  const Eye eye = Eye::of(camera, size, pass.samples);
  views_[number] = eye.view({}, camera.light, middle);
  for (const GlItem& item : std::span(scene.items).subspan(camera.first_item, camera.num_items)) {
    if (item.ids != 0 && item.ids == camera.hidden_ids) continue;
    const bool is_solid = item.scale != GlItem().scale;  // its chunks have another scale
    const bool is_everywhere = std::isinf(item.radius);
    if (!is_everywhere && eye.misses(item.position, Vec3::Constant(item.radius), pass)) continue;
    const Eye local = eye.in_frame_of(item);
    const UploadedModel& model = models_[item.model];
    const auto view = static_cast<GLuint>(views_.size());
    std::vector<DrawCommand>& commands = commands_[item.only_front ? 1 : 0];
    const std::size_t before = commands.size();
    for (const GlChunk& chunk : model.chunks) {
      if (!is_solid && local.misses(chunk.center, chunk.half, pass)) continue;
      DrawCommand* const last = commands.size() > before ? &commands.back() : nullptr;
      if (last != nullptr && 3 * chunk.first_triangle == last->first_index + last->count) {
        last->count += 3 * chunk.num_triangles;
      } else {
        commands.push_back({.count = 3 * chunk.num_triangles,
                            .instance_count = 1,
                            .first_index = 3 * chunk.first_triangle,
                            .base_vertex = model.first_vertex,
                            .base_instance = 0,
                            .first_triangle = chunk.first_triangle,
                            .view = view});
      }
    }
    if (commands.size() == before) continue;
    views_.push_back(local.view(item, camera.light, middle));
    shows_textures_ |= model.is_textured;
    shows_masks_ |= model.is_masked;
  }
}

void GlPainter::resolve(const GlAtlas& samples, const GlAtlas& into, int side, int tiles) {
  glBindFramebuffer(GL_DRAW_FRAMEBUFFER, into.framebuffer());
  glViewport(0, 0, into.size().width, into.size().height * tiles);
  const auto keep_others = [](GLboolean written) {
    for (const GLuint i : {1U, 2U}) glColorMaski(i, written, written, written, written);
  };
  keep_others(GL_FALSE);
  glUseProgram(shaders_.get(GlShaders::Role::resolve, {.writes = {.color = true}}));
  glUniform1i(kSamplesUniform, side);
  glBindTextureUnit(0, samples.color());
  glBindVertexArray(no_array_.name());
  glDrawArrays(GL_TRIANGLES, 0, 3);
  keep_others(GL_TRUE);
}

}  // namespace flockstep::render
