// GlObject: owner of an OpenGL object. Create, use and destroy it on the thread whose current context it belongs to.
#pragma once

#include <epoxy/gl.h>

#include <utility>

namespace flockstep::render {

class GlObject {
 public:
  using Destroy = void (*)(GLuint name);

  GlObject() = default;  // owns nothing
  GlObject(GLuint name, Destroy destroy) : name_(name), destroy_(destroy) {}
  // create: one of the functions that make several names, such as glCreateBuffers.
  template <class Create>
  static GlObject made_by(const Create& create, Destroy destroy) {
    GLuint name = 0;
    create(1, &name);
    return {name, destroy};
  }
  GlObject(GlObject&& other) noexcept : name_(std::exchange(other.name_, 0)), destroy_(other.destroy_) {}
  GlObject& operator=(GlObject&& other) noexcept {
    std::swap(name_, other.name_);
    std::swap(destroy_, other.destroy_);
    return *this;
  }
  GlObject(const GlObject&) = delete;
  GlObject& operator=(const GlObject&) = delete;
  ~GlObject() {
    if (name_ != 0) destroy_(name_);
  }

  GLuint name() const { return name_; }

 private:
  GLuint name_ = 0;
  Destroy destroy_ = nullptr;
};

inline GlObject make_buffer() {
  return GlObject::made_by(glCreateBuffers, [](GLuint name) { glDeleteBuffers(1, &name); });
}
inline GlObject make_texture() {
  return GlObject::made_by([](GLsizei count, GLuint* names) { glCreateTextures(GL_TEXTURE_2D, count, names); },
                           [](GLuint name) { glDeleteTextures(1, &name); });
}
inline GlObject make_framebuffer() {
  return GlObject::made_by(glCreateFramebuffers, [](GLuint name) { glDeleteFramebuffers(1, &name); });
}
inline GlObject make_vertex_array() {
  return GlObject::made_by(glCreateVertexArrays, [](GLuint name) { glDeleteVertexArrays(1, &name); });
}
inline GlObject make_shader(GLenum stage) {
  return {glCreateShader(stage), [](GLuint name) { glDeleteShader(name); }};
}
inline GlObject make_program() {
  return {glCreateProgram(), [](GLuint name) { glDeleteProgram(name); }};
}

}  // namespace flockstep::render
