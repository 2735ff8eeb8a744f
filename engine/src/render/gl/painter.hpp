// GlPainter: draws the views of many cameras into an atlas, with a few draw calls for all of them.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "render/appearance.hpp"
#include "render/gl/atlas.hpp"
#include "render/gl/model.hpp"
#include "render/gl/objects.hpp"
#include "render/gl/shaders.hpp"
#include "render/gl/sun_grid.hpp"

namespace flockstep::render {

// GlStore: a buffer of equal elements that grows only at its end, and is cleared as a whole.
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

// The content of one tile of an atlas: the image of a camera, or a part of it.
struct TileCamera {
  std::uint32_t model = 0;                       // number given by add()
  Vec3 position;                                 // m, world frame
  Mat3 rotation;                                 // camera to world
  float fx = 1, fy = 1;                          // px
  float cx = 0, cy = 0;                          // px, from the tile's upper left
  std::uint32_t first_body = 0, num_bodies = 0;  // in GlBodies::solids
  std::uint32_t first_mesh = 0, num_meshes = 0;  // in GlBodies::meshes
  std::uint32_t hidden_ids = 0;                  // GlMeshBody::ids of the drone that carries the camera; 0: none

  bool shows(const GlMeshBody& mesh) const { return mesh.ids != hidden_ids; }
};

struct GlPass {
  float near_m = 0, far_m = 0;  // m, planar depths
  ShaderTraits traits;
  // Side of the sample grid within a pixel. A tile of the atlas is this many times wider and higher than its image.
  int samples = 1;
};

class GlPainter {
 public:
  GlPainter();

  // Copies a model to the device. Models are numbered from 0.
  void add(const GlModel& model);
  // Discards all models, sun grids and caster trees, and keeps their memory for the next ones.
  void forget_models();
  // Copies the sun grid of a model. Call it before the first pass with shadows that shows the model.
  void add(std::uint32_t model, const GlSunGrid& grid);
  // Copies the caster tree of the model of a mesh body. Call it before the first pass with shadows that shows the body.
  void add(std::uint32_t model, const GlCasterTree& tree);

  // Clears the atlas and draws one tile per camera. bodies: of all cameras; those of one env follow each other.
  void paint(const GlAtlas& atlas, std::span<const TileCamera> cameras, const GlBodies& bodies, const GlPass& pass);
  // Averages the sample grid of each pixel.
  void resolve(const GlAtlas& samples, const GlAtlas& into, int side, int tiles);

 private:
  // Data of a model that stays on the CPU, and its offsets into the buffers.
  struct UploadedModel {
    GLint first_vertex = 0;
    std::vector<FlatChunk> chunks;  // first_index counts in indices_
    std::array<std::uint32_t, kNumRoundKinds> first_shape{};
    std::array<std::vector<RoundBound>, kNumRoundKinds> bounds;
    std::vector<Aabb> rooms;
    Light light;
    SunDisc sun_disc{Light()};
    std::uint32_t grid = 0;              // index into grids_
    std::optional<std::uint32_t> nodes;  // index of the first one in nodes_; none if it casts no shadow
    bool is_painted = false, is_masked = false;
  };
  // A TileCamera in the layout of the shaders; each row is a vec4.
  struct CameraRecord {
    std::array<float, 4> eye_offset, w_cx, x_cy, y_fx, ray_0_fy, ray_u, ray_v_grid, horizon, zenith_glow, sun_edge,
        disc_steepness, air;
  };
  // A mesh body seen by a camera, in the layout of the shaders; each row is a vec4.
  struct PosedRecord {
    std::array<float, 3> axis_x;
    std::uint32_t camera;
    std::array<float, 3> axis_y;
    std::uint32_t ids;
    std::array<float, 3> axis_z;
    float gamma_exponent;
    std::array<float, 4> middle, slope, sun, sun_direction;
  };
  // A sun grid in the layout of the shaders; each row is a vec4.
  struct GridRecord {
    std::array<std::array<float, 4>, 3> to_sun;  // columns
    std::array<float, 4> left_low_cell;
    std::array<std::uint32_t, 4> size;
  };
  struct DrawCommand {  // in the layout of OpenGL
    GLuint count, instance_count, first_index;
    GLint base_vertex;
    GLuint base_instance;
  };
  struct VisibleShape {  // in the layout of the shaders
    std::uint32_t camera, shape;
  };
  // Shapes drawn as rectangles, and shapes drawn as boxes; see shaders.cpp.
  using VisibleShapes = std::array<std::vector<VisibleShape>, 2>;
  struct Plane {
    Vec3 normal;   // unit, inwards
    float offset;  // m
  };
  using Frustum = std::array<Plane, 6>;
  // A tile's camera in some frame, in double precision. The names are those of the shaders' Camera.
  struct View {
    Eigen::Vector3d eye, w, x, y, ray_0, ray_u, ray_v;

    View in_frame_of(const GlMeshBody& body) const;
    Frustum frustum(const GlPass& pass) const;
  };

  const GlBuffer& camera_buffer() const { return cameras_[painted_last_]; }
  void add_paints(const GlModel& model, std::size_t first_vertex);
  // Returns the index of the first caster, and adds an offset to the masks' alphas.
  std::uint32_t add_masks(const SunMasks& masks);
  std::uint32_t list_casters(const TileCamera& camera, const GlBodies& bodies);
  void cull(const TileCamera& camera, std::size_t num_cameras, std::uint32_t number, const GlBodies& bodies, const GlAtlas& atlas,
            const GlPass& pass);
  static PosedRecord posed_record(const GlMeshBody& mesh, std::uint32_t camera, const Light& light);
  static void cull_flat(const UploadedModel& model, const Frustum& frustum, std::uint32_t number,
                        std::vector<DrawCommand>& commands);
  void cull_round(const UploadedModel& model, const Frustum& frustum, const TileCamera& camera, const GlPass& pass,
                  std::uint32_t number);
  void cull_bodies(std::span<const GlBody> bodies, const Frustum& frustum, const TileCamera& camera, const GlPass& pass,
                   std::uint32_t number);
  void draw_flat(const std::vector<DrawCommand>& commands, bool painted);
  void draw_round(const VisibleShapes& shown, bool boxes, GLuint shapes);
  void draw_sky();

  GlShaders shaders_;
  std::vector<UploadedModel> models_;
  GlStore<FlatVertex> vertices_;
  GlStore<PaintedVertex> painted_;  // parallel to vertices_; entries of the last models may be missing
  GlStore<Paint> paints_;
  GlStore<std::uint32_t> texels_;
  GlStore<std::array<std::uint32_t, 4>> textures_;
  GlStore<std::uint32_t> indices_;
  std::array<GlStore<RoundShape>, kNumRoundKinds> shapes_;
  GlStore<GridRecord> grids_;
  GlStore<std::uint32_t> starts_, entries_;
  GlStore<SunCaster> casters_;
  GlStore<CasterNode> nodes_;
  GlVertexArray flat_array_, box_array_, quad_array_, no_array_;
  GlBuffer boxes_, quads_;  // index patterns of many boxes and quads
  // Rewritten by each paint(). Fragment shaders read the cameras, and Mesa's software device may run those of one paint() when
  // the next one has already begun, so two buffers take turns.
  std::array<GlBuffer, 2> cameras_;
  std::size_t painted_last_ = 0;
  GlBuffer commands_, visible_buffer_, body_buffer_, body_casters_, posed_buffer_;

  std::vector<CameraRecord> records_;        // one per camera, then posed_cameras_
  std::vector<CameraRecord> posed_cameras_;  // one per element of posed_, in the body's frame
  std::vector<PosedRecord> posed_;           // one per camera and mesh body in its view
  std::vector<DrawCommand> flat_commands_, posed_commands_;
  std::array<VisibleShapes, kNumRoundKinds> visible_;
  std::array<VisibleShapes, kNumRoundKinds> visible_bodies_;  // indices into body_shapes_
  std::array<std::vector<RoundShape>, kNumRoundKinds> body_shapes_;
  // Lists of the casters among the bodies, each with an empty caster at its end. The first list is empty.
  std::vector<SunCaster> caster_lists_;
  // The first solid, the first mesh, the hidden mesh and the first caster of the last list.
  std::uint32_t listed_body_ = 0, listed_mesh_ = 0, listed_without_ = 0, last_list_ = 0;
  bool meshes_cast_ = false;  // some caster in the lists is a mesh
  std::vector<std::uint32_t> sky_cameras_;
};

}  // namespace flockstep::render
