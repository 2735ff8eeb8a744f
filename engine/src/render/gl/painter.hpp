// GlPainter: draws the views of many cameras into an atlas, with a few draw calls for all of them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "render/gl/atlas.hpp"
#include "render/gl/model.hpp"
#include "render/gl/objects.hpp"
#include "render/gl/shaders.hpp"

namespace flockstep::render {

// GlStore: a buffer of equal elements that grows only at its end.
template <class T>
class GlStore {
 public:
  // Returns the index of the first appended element.
  std::uint32_t append(std::span<const T> elements) {
    const std::size_t first = size_;
    if (size_ + elements.size() > capacity_) grow(size_ + elements.size());
    if (!elements.empty()) {
      glNamedBufferSubData(buffer_.name(), static_cast<GLintptr>(first * sizeof(T)),
                           static_cast<GLsizeiptr>(elements.size_bytes()), elements.data());
    }
    size_ += elements.size();
    return static_cast<std::uint32_t>(first);
  }

  std::size_t size() const { return size_; }
  GLuint name() const { return buffer_.name(); }  // changes when the buffer grows; 0 while it is empty

 private:
  void grow(std::size_t needed) {
    capacity_ = std::max(needed, size_ + size_ / 2);
    GlObject larger = make_buffer();
    glNamedBufferStorage(larger.name(), static_cast<GLsizeiptr>(capacity_ * sizeof(T)), nullptr, GL_DYNAMIC_STORAGE_BIT);
    if (size_ != 0) glCopyNamedBufferSubData(buffer_.name(), larger.name(), 0, 0, static_cast<GLsizeiptr>(size_ * sizeof(T)));
    buffer_ = std::move(larger);
  }

  GlObject buffer_;
  std::size_t size_ = 0;
  std::size_t capacity_ = 0;
};

// A model at a pose: a world, a marker, a body or a drone.
struct GlItem {
  std::uint32_t model = 0;                                // number given by GlPainter::add()
  std::uint32_t ids = 0;                                  // the whole item's, see pack_ids(); 0: its triangles have their own
  std::uint32_t first_color = 0;                          // its materials' first, in GlScene::colors
  Vec3 position = Vec3::Zero();                           // m, world frame
  Mat3 rotation = Mat3::Identity();                       // to the world frame
  float radius = std::numeric_limits<float>::infinity();  // m, of the ball around the position that contains it
  std::array<float, 4> scale{1.0F, 1.0F, 1.0F, 0.0F};     // see GlView
  std::array<float, 3> color{1.0F, 1.0F, 1.0F};           // multiplies the base colours
  bool only_front = false;                                // invisible from inside
};

// The colours of a material, linear, in the layout of the shaders.
struct GlColor {
  std::array<float, 4> base, emission;
};

// The content of one tile of an atlas: the image of a camera, or a part of it.
struct TileCamera {
  Light light;
  Vec3 position;                                // m, world frame
  Mat3 rotation;                                // camera to world
  float fx = 1, fy = 1;                         // px
  float cx = 0, cy = 0;                         // px, from the tile's upper left
  std::uint32_t first_item = 0, num_items = 0;  // in GlScene::items
  std::uint32_t hidden_ids = 0;                 // GlItem::ids of the drone that carries the camera; 0: none
};

struct GlScene {
  std::vector<GlItem> items;  // all envs'
  std::vector<GlColor> colors;
  std::vector<TileCamera> cameras;
};

struct GlPass {
  float near_m = 0, far_m = 0;  // m, planar depths
  Attachments writes;
  // Side of the sample grid within a pixel. A tile of the atlas is this many times wider and higher than its image.
  int samples = 1;
};

class GlPainter {
 public:
  GlPainter();

  // Copies a model to the device. Models are numbered from 0.
  void add(const GlModel& model);

  // Clears the atlas and draws one tile for each of these cameras of the scene.
  void paint(const GlAtlas& atlas, const GlScene& scene, std::span<const TileCamera> cameras, const GlPass& pass);
  // Averages the sample grid of each pixel.
  void resolve(const GlAtlas& samples, const GlAtlas& into, int side, int tiles);

 private:
  // Data of a model that stays on the CPU, and its offsets into the buffers.
  struct UploadedModel {
    GLint first_vertex = 0;
    std::vector<GlChunk> chunks;  // first_triangle counts in triangles_
    bool is_textured = false, is_masked = false;
  };
  struct DrawCommand {  // OpenGL's layout, up to the view
    GLuint count, instance_count, first_index;
    GLint base_vertex;
    GLuint base_instance;  // index of this command
    GLuint first_triangle, view;
  };
  struct Eye;  // a tile's camera in some frame

  void see(const TileCamera& camera, std::uint32_t number, const GlScene& scene, const AtlasSize& size, const GlPass& pass);

  GlShaders shaders_;
  std::vector<UploadedModel> models_;
  GlStore<GlVertex> vertices_;
  GlStore<std::array<std::uint32_t, 3>> corners_;
  GlStore<GlTriangle> triangles_;  // parallel to corners_
  GlStore<std::uint32_t> texels_;
  GlStore<std::array<std::uint32_t, 4>> textures_;
  GlObject array_, no_array_;
  // Rewritten by each paint(). Fragment shaders read them, and Mesa's software device may run those of one paint() when the next
  // one has already begun, so two take turns.
  struct Frame {
    GlObject views = make_buffer(), colors = make_buffer();
  };
  std::array<Frame, 2> frames_;
  std::size_t painted_last_ = 0;
  GlObject commands_buffer_;

  std::vector<GlView> views_;                         // one per camera, for the sky, then one per item and camera
  std::array<std::vector<DrawCommand>, 2> commands_;  // items seen from everywhere, and only from the front
  bool shows_textures_ = false, shows_masks_ = false;
};

}  // namespace flockstep::render
