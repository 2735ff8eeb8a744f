// GlStore: a buffer of equal elements that grows only at its end, and is cleared as a whole.
#pragma once

#include <algorithm>
#include <cstddef>
#include <span>

#include "render/gl/objects.hpp"

namespace flockstep::render {

template <class T>
class GlStore {
 public:
  // Returns the index of the first appended element.
  std::size_t append(std::span<const T> elements) {
    const std::size_t first = size_;
    if (size_ + elements.size() > capacity_) grow(size_ + elements.size());
    if (!elements.empty()) {
      glNamedBufferSubData(buffer_.name(), static_cast<GLintptr>(first * sizeof(T)),
                           static_cast<GLsizeiptr>(elements.size_bytes()), elements.data());
    }
    size_ += elements.size();
    return first;
  }

  void clear() { size_ = 0; }

  std::size_t size() const { return size_; }
  GLuint name() const { return buffer_.name(); }  // changes when the buffer grows; 0 while it is empty

 private:
  void grow(std::size_t needed) {
    capacity_ = std::max(needed, size_ + size_ / 2);
    GlBuffer larger = GlBuffer::make();
    glNamedBufferStorage(larger.name(), static_cast<GLsizeiptr>(capacity_ * sizeof(T)), nullptr, GL_DYNAMIC_STORAGE_BIT);
    if (size_ != 0) glCopyNamedBufferSubData(buffer_.name(), larger.name(), 0, 0, static_cast<GLsizeiptr>(size_ * sizeof(T)));
    buffer_ = std::move(larger);
  }

  GlBuffer buffer_;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

}  // namespace flockstep::render
