// Plain use of OpenGL. The benchmarks compare the engine's OpenGL cameras against it. Each camera is a tile of one atlas with a
// viewport and a uniform. It takes one draw call for all triangles, or one per row of visible cells in a grid over the
// triangles. Then the attachments are read back.
#pragma once

#include <epoxy/gl.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/gl/egl_context.hpp"

namespace bench {

class BareGl {
 public:
  // colors: linear, one per triangle.
  BareGl(const flockstep::TriangleMesh& mesh, const std::vector<std::array<float, 3>>& colors, const flockstep::Light& light,
         float near_m)
      : context_(flockstep::render::egl_devices()), near_m_(near_m) {
    program_ = glCreateProgram();
    attach(GL_VERTEX_SHADER, kVertexShader);
    attach(GL_FRAGMENT_SHADER, kFragmentShader);
    glLinkProgram(program_);
    GLint linked = 0;
    glGetProgramiv(program_, GL_LINK_STATUS, &linked);
    if (linked == 0) fail("the program does not link");
    glUseProgram(program_);
    const auto set = [&](const char* name, const std::array<float, 3>& value) {
      glUniform3fv(glGetUniformLocation(program_, name), 1, value.data());
    };
    set("to_sun", light.sun_direction);
    set("sun", light.sun_color);
    set("sky", light.sky_ambient);
    set("ground", light.ground_ambient);

    std::vector<float> vertices;
    for (const flockstep::Vec3& v : mesh.vertices) vertices.insert(vertices.end(), {v.x(), v.y(), v.z()});
    std::vector<std::int32_t> indices;
    std::vector<float> facets;  // normal and colour per triangle, as two vec4
    for (const std::uint32_t i : sort_into_cells(mesh)) {
      const auto corner = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(mesh.triangles[i][k])]; };
      const flockstep::Vec3 n = (corner(1) - corner(0)).cross(corner(2) - corner(0)).normalized();
      facets.insert(facets.end(), {n.x(), n.y(), n.z(), 0.0F, colors[i][0], colors[i][1], colors[i][2], 0.0F});
      indices.insert(indices.end(), mesh.triangles[i].begin(), mesh.triangles[i].end());
    }
    glCreateVertexArrays(1, &array_);
    glBindVertexArray(array_);
    buffer(GL_ARRAY_BUFFER, vertices);
    glVertexAttribPointer(0, 3, GL_FLOAT, GL_FALSE, 12, nullptr);
    glEnableVertexAttribArray(0);
    buffer(GL_ELEMENT_ARRAY_BUFFER, indices);
    glBindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, buffer(GL_SHADER_STORAGE_BUFFER, facets));
    glEnable(GL_DEPTH_TEST);
    glDepthFunc(GL_GREATER);
    glClipControl(GL_UPPER_LEFT, GL_ZERO_TO_ONE);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
  }
  BareGl(const BareGl&) = delete;
  BareGl& operator=(const BareGl&) = delete;
  // Destroying the context frees all OpenGL objects.

  void make_atlas(int width, int height, int count) {
    width_ = width;
    height_ = height;
    glCreateFramebuffers(1, &frame_);
    glBindFramebuffer(GL_FRAMEBUFFER, frame_);
    const auto attachment = [&](GLenum format, GLenum where) {
      GLuint texture = 0;
      glCreateTextures(GL_TEXTURE_2D, 1, &texture);
      glTextureStorage2D(texture, 1, format, width, height * count);
      glNamedFramebufferTexture(frame_, where, texture, 0);
    };
    attachment(GL_RGBA8, GL_COLOR_ATTACHMENT0);
    attachment(GL_R32F, GL_COLOR_ATTACHMENT1);
    attachment(GL_DEPTH_COMPONENT32F, GL_DEPTH_ATTACHMENT);
    const std::array<GLenum, 2> targets{GL_COLOR_ATTACHMENT0, GL_COLOR_ATTACHMENT1};
    glNamedFramebufferDrawBuffers(frame_, 2, targets.data());
    if (glCheckNamedFramebufferStatus(frame_, GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) fail("the framebuffer is incomplete");
    rgba.resize(4 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height * count));
    depth.resize(rgba.size() / 4);
  }

  // rotation: camera (x forward, y left, z up) to world; culled: skip cells outside the view.
  void render(const std::vector<flockstep::Vec3>& position, const std::vector<flockstep::Mat3>& rotation, float fx, float fy,
              bool culled) {
    const auto count = static_cast<int>(position.size());
    glViewport(0, 0, width_, height_ * count);
    constexpr std::array<float, 4> kSky{0.8F, 0.9F, 1.0F, 1.0F}, kNothing{1e30F, 0, 0, 0};
    constexpr float kFarthest = 0.0F;
    glClearNamedFramebufferfv(frame_, GL_COLOR, 0, kSky.data());
    glClearNamedFramebufferfv(frame_, GL_COLOR, 1, kNothing.data());
    glClearNamedFramebufferfv(frame_, GL_DEPTH, 0, &kFarthest);
    const GLint matrix = glGetUniformLocation(program_, "to_clip");
    const GLint eye = glGetUniformLocation(program_, "eye");
    const GLint first = glGetUniformLocation(program_, "first");
    for (int i = 0; i < count; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const flockstep::Mat3 to_camera = rotation[at].transpose();
      Eigen::Matrix4f to_clip = Eigen::Matrix4f::Zero();
      to_clip.block<1, 3>(0, 0) = -2.0F * fx / static_cast<float>(width_) * to_camera.row(1);
      to_clip.block<1, 3>(1, 0) = 2.0F * fy / static_cast<float>(height_) * to_camera.row(2);
      to_clip.block<1, 3>(3, 0) = to_camera.row(0);
      to_clip.block<4, 1>(0, 3) = -to_clip.block<4, 3>(0, 0) * position[at];
      to_clip(2, 3) = near_m_;  // reversed z with an infinite far plane
      glUniformMatrix4fv(matrix, 1, GL_FALSE, to_clip.data());
      glUniform3fv(eye, 1, position[at].data());
      glViewport(0, height_ * i, width_, height_);
      const float across = 0.5F * static_cast<float>(width_) / fx, along = 0.5F * static_cast<float>(height_) / fy;
      const flockstep::Mat3& r = rotation[at];
      const std::array<flockstep::Vec3, 5> sides{r.col(0), across * r.col(0) + r.col(1), across * r.col(0) - r.col(1),
                                                 along * r.col(0) + r.col(2), along * r.col(0) - r.col(2)};
      const auto is_seen = [&](const Cell& cell) {
        return !culled || std::all_of(sides.begin(), sides.end(), [&](const flockstep::Vec3& side) {
          return side.dot(cell.center - position[at]) + side.cwiseAbs().dot(cell.half) >= 0.0F;
        });
      };
      for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
        if (!is_seen(cells_[cell])) continue;
        const std::uint32_t from = cells_[cell].first;
        while (cell + 1 < cells_.size() && is_seen(cells_[cell + 1])) ++cell;
        const std::uint32_t count = cells_[cell].first + cells_[cell].count - from;
        glUniform1i(first, static_cast<GLint>(from));
        glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(3 * count), GL_UNSIGNED_INT,
                       reinterpret_cast<const void*>(3 * sizeof(std::int32_t) * from));
      }
    }
    glReadBuffer(GL_COLOR_ATTACHMENT0);
    glReadPixels(0, 0, width_, height_ * count, GL_RGBA, GL_UNSIGNED_BYTE, rgba.data());
    glReadBuffer(GL_COLOR_ATTACHMENT1);
    glReadPixels(0, 0, width_, height_ * count, GL_RED, GL_FLOAT, depth.data());
  }

  std::vector<std::uint8_t> rgba;  // (N, H, W, 4), last render
  std::vector<float> depth;        // (N, H, W)

 private:
  static constexpr const char* kVertexShader = R"(#version 450 core
layout(location = 0) in vec3 position;
uniform mat4 to_clip;
uniform vec3 eye;
out vec3 from_eye;
void main() {
  gl_Position = to_clip * vec4(position, 1.0);
  from_eye = position - eye;
})";
  static constexpr const char* kFragmentShader = R"(#version 450 core
layout(std430, binding = 0) readonly buffer Facets { vec4 facets[]; };
uniform vec3 to_sun, sun, sky, ground;
uniform int first;
in vec3 from_eye;
layout(location = 0) out vec4 color;
layout(location = 1) out float depth;
void main() {
  int facet = 2 * (first + gl_PrimitiveID);
  vec3 n = facets[facet].xyz;
  n = dot(n, from_eye) > 0.0 ? -n : n;
  vec3 light = mix(ground, sky, 0.5 + 0.5 * n.z) + sun * max(0.0, dot(n, to_sun));
  color = vec4(pow(min(facets[facet + 1].xyz * light, 1.0), vec3(1.0 / 2.2)), 1.0);
  depth = 1.0 / gl_FragCoord.w;
})";

  struct Cell {
    std::uint32_t first = 0, count = 0;  // in triangles
    flockstep::Vec3 center, half;
  };

  // Groups the triangles into square cells of about 500 triangles, row by row. Returns the triangle indices in that order.
  std::vector<std::uint32_t> sort_into_cells(const flockstep::TriangleMesh& mesh) {
    constexpr double kTriangles = 500.0;
    Eigen::AlignedBox3f all;
    for (const flockstep::Vec3& v : mesh.vertices) all.extend(v);
    const int side = std::max(1, static_cast<int>(std::sqrt(static_cast<double>(mesh.triangles.size()) / kTriangles)));
    std::vector<std::vector<std::uint32_t>> members(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
    std::vector<Eigen::AlignedBox3f> bounds(members.size());
    for (std::uint32_t i = 0; i < mesh.triangles.size(); ++i) {
      Eigen::AlignedBox3f box;
      for (const int corner : mesh.triangles[i]) box.extend(mesh.vertices[static_cast<std::size_t>(corner)]);
      const auto place = [&](int axis) {
        const float share = (box.center()[axis] - all.min()[axis]) / all.sizes()[axis];
        return std::clamp(static_cast<int>(share * static_cast<float>(side)), 0, side - 1);
      };
      const auto cell = static_cast<std::size_t>(place(1) * side + place(0));
      members[cell].push_back(i);
      bounds[cell].extend(box);
    }
    std::vector<std::uint32_t> order;
    for (std::size_t cell = 0; cell < members.size(); ++cell) {
      if (members[cell].empty()) continue;
      cells_.push_back({static_cast<std::uint32_t>(order.size()), static_cast<std::uint32_t>(members[cell].size()),
                        bounds[cell].center(), bounds[cell].sizes() / 2});
      order.insert(order.end(), members[cell].begin(), members[cell].end());
    }
    return order;
  }

  [[noreturn]] static void fail(const char* what) {
    std::fprintf(stderr, "bare OpenGL: %s\n", what);
    std::exit(1);
  }
  void attach(GLenum kind, const char* source) const {
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &source, nullptr);
    glCompileShader(shader);
    GLint compiled = 0;
    glGetShaderiv(shader, GL_COMPILE_STATUS, &compiled);
    if (compiled == 0) fail("a shader does not compile");
    glAttachShader(program_, shader);
  }
  template <class T>
  static GLuint buffer(GLenum target, const std::vector<T>& values) {
    GLuint name = 0;
    glCreateBuffers(1, &name);
    glNamedBufferStorage(name, static_cast<GLsizeiptr>(values.size() * sizeof(T)), values.data(), 0);
    glBindBuffer(target, name);
    return name;
  }

  flockstep::render::EglContext context_;
  float near_m_;
  std::vector<Cell> cells_;
  GLuint program_ = 0, array_ = 0, frame_ = 0;
  int width_ = 0, height_ = 0;
};

}  // namespace bench
