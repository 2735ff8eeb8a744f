#include "render/gl/shaders.hpp"

#include <array>
#include <string>

#include "render/appearance.hpp"
#include "render/gl/egl_context.hpp"

namespace flockstep::render {
namespace {

// Declarations shared by all shaders. For a mesh body, a further Camera describes the camera of a tile in the body's frame
// instead of the world's. Tiles are stacked vertically in the atlas. Row 0 of a tile, the top of its image, has
// the lowest y. The ray through a pixel is ray_0 + ray_u u + ray_v v, with u and v taken at the centre of the pixel and
// counted from the upper left of its tile. The planar depth of this vector is one metre. The depth buffer holds (1 / depth -
// 1 / far) / (1 / near - 1 / far), which is 1 at the near plane and 0 at the far plane. This value is as accurate as the
// depth itself at every distance, and triangles interpolate it linearly. Depth images are read from this buffer.
constexpr const char* kCommon = R"(#version 450 core
layout(location = 0) uniform vec4 tiles;
layout(location = 1) uniform vec4 range;
#define tile_height tiles.x
#define tiles_per_pixel tiles.y
#define tile_share tiles.z
#define near range.x
#define far range.y
#define farness range.z    // 1 / far
#define nearness_scale range.w  // 1 / (1 / near - 1 / far)

struct Camera {
  vec4 eye_offset;  // xyz: the eye (m, world frame); w: y of the tile's middle in the atlas, from -1 to 1
  vec4 w_cx;        // xyz: the dot product with a point relative to the eye is the clip w, the planar depth; w: cx, px
  vec4 x_cy;        // xyz: the same for the clip x; w: cy, px
  vec4 y_fx;        // xyz: the same for the clip y, within the tile; w: 1 / fx
  vec4 ray_0_fy;    // w: 1 / fy
  vec4 ray_u_casters;  // w: first entry of BodyCasters for the bodies of this camera's env; of a mesh body: its PosedMesh
  vec4 ray_v_grid;  // w: index of the sun's grid
  vec4 horizon;  // w: 1 / gamma
  vec4 zenith_glow;
  vec4 sun_edge;  // xyz: direction to the sun; see SunDisc
  vec4 disc_steepness;  // xyz: colour of the sun
  vec4 air;  // x: Air::fog_per_m
};
)";

constexpr const char* kVertexCommon = R"(
out gl_PerVertex {
  vec4 gl_Position;
  float gl_ClipDistance[2];
};

// A tile is as wide as the atlas; other tiles lie above and below it.
void place(vec3 clip, float depth, float tile_middle) {
  float w = clip.z;
  gl_Position = vec4(clip.x, clip.y * tile_share + w * tile_middle, depth, w);
  gl_ClipDistance[0] = w + clip.y;
  gl_ClipDistance[1] = w - clip.y;
}

#ifdef SHADOWS
struct Grid {
  mat3 to_sun;
  vec4 left_low_cell;  // w: 1 / cell
  uvec4 size;          // columns, rows, offset of its starts, offset of its masks
};
layout(std430, binding = 3) readonly buffer Grids { Grid grids[]; };

// The rays in the sun's frame, and its grid.
layout(location = 11) flat out vec4 sun_eye_left;
layout(location = 12) flat out vec4 sun_ray_0_low;
layout(location = 13) flat out vec4 sun_ray_u_cells;  // w: cells per metre
layout(location = 14) flat out vec3 sun_ray_v;
layout(location = 15) flat out uvec4 sun_grid;
#ifdef BODIES
layout(location = 10) flat out uint first_body_caster;
#endif

void look_at_sun(vec3 eye, vec3 ray_0, vec4 ray_u_casters, vec4 ray_v_grid) {
  Grid grid = grids[uint(ray_v_grid.w)];
  vec3 ray_u = ray_u_casters.xyz;
  vec3 ray_v = ray_v_grid.xyz;
  sun_eye_left = vec4(grid.to_sun * eye, grid.left_low_cell.x);
  sun_ray_0_low = vec4(grid.to_sun * ray_0, grid.left_low_cell.y);
  sun_ray_u_cells = vec4(grid.to_sun * ray_u, grid.left_low_cell.w);
  sun_ray_v = grid.to_sun * ray_v;
  sun_grid = grid.size;
#ifdef BODIES
  first_body_caster = uint(ray_u_casters.w);
#endif
}
#endif
)";

constexpr const char* kFragmentCommon = R"(
#ifdef COLOR
layout(location = 0) out vec4 out_color;
#endif
#ifdef IDS
layout(location = 1) out uvec2 out_ids;
#endif
#ifdef NORMAL
layout(location = 2) out vec4 out_normal;
#endif

// (1, u, v) of the pixel within its tile.
vec3 pixel() {
  float y = gl_FragCoord.y;
  return vec3(1.0, gl_FragCoord.x, y - tile_height * floor(y * tiles_per_pixel));
}

vec4 encode(vec3 light, float gamma_exponent) {
  return vec4(floor(255.0 * pow(min(light, 1.0), vec3(gamma_exponent)) + 0.5) / 255.0, 1.0);
}

#ifdef AIR
layout(std430, binding = 0) readonly buffer Cameras { Camera cameras[]; };

// Returns the colour of a surface at this depth behind fog; see Light. Camera i draws tile i.
vec3 through_fog(vec3 light, float depth, vec3 at) {
  Camera camera = cameras[uint(gl_FragCoord.y * tiles_per_pixel)];
  vec3 ray = camera.ray_0_fy.xyz + camera.ray_u_casters.xyz * at.y + camera.ray_v_grid.xyz * at.z;
  float metres = length(ray);
  vec3 sky = mix(camera.horizon.xyz, camera.zenith_glow.xyz, max(0.0, ray.z) / metres);
  return mix(sky, light, exp(-camera.air.x * depth * metres));
}
#else
#define through_fog(light, depth, at) (light)
#endif
)";

constexpr const char* kFlatVertex = R"(
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in uvec2 sunlit;
layout(location = 3) in uvec2 shadowy;
layout(location = 4) in uint ids;
layout(location = 5) in vec4 eye_offset;  // the camera, one per instance
layout(location = 6) in vec4 w_cx;
layout(location = 7) in vec4 x_cy;
layout(location = 8) in vec4 y_fx;
layout(location = 9) in vec4 ray_0_fy;
layout(location = 10) in vec4 ray_u_casters;
layout(location = 11) in vec4 ray_v_grid;

layout(location = 0) flat out vec3 nearness;
layout(location = 1) flat out uvec3 tints_ids;  // colours in the sun and in shadow, ids
#ifdef NORMAL
layout(location = 2) flat out vec3 facing;
#endif
#ifdef POSED
layout(std430, binding = 0) readonly buffer Cameras { Camera cameras[]; };
// A mesh body seen by a camera: its rotation into the world frame and the light there.
struct PosedMesh {
  vec3 axis_x;
  uint camera;  // number of the camera in the world frame
  vec3 axis_y;
  uint ids;
  vec3 axis_z;
  float gamma_exponent;
  vec4 middle;  // ambient light: middle + slope * n.z
  vec4 slope;
  vec4 sun;
  vec4 sun_direction;
};
layout(std430, binding = 10) readonly buffer PosedMeshes { PosedMesh posed_meshes[]; };
#endif
#ifdef PAINT
layout(location = 12) in vec2 uv;
layout(location = 13) in float density;
layout(location = 14) in uint paint_number;
layout(location = 15) in vec3 color;

struct Paint {
  vec4 middle_gamma;
  vec4 slope_texture;
  vec4 sun_cutoff;
  vec4 sun_direction;
};
layout(std430, binding = 7) readonly buffer Paints { Paint paints[]; };

layout(location = 3) out vec2 texture_at;
layout(location = 4) flat out vec4 lens;
layout(location = 5) flat out vec4 in_sun_height;
layout(location = 6) flat out vec4 in_shadow_gamma;
layout(location = 7) flat out vec4 painted_texture_density;  // 1 if painted, texture index plus 1, density, cutoff
layout(location = 8) out vec3 tint;

void paint(vec3 n, float height) {
  texture_at = uv;
  tint = color;
  painted_texture_density = vec4(0.0);
  if (paint_number == 0u) return;
  Paint record = paints[paint_number - 1u];
#ifdef POSED
  PosedMesh posed = posed_meshes[uint(ray_u_casters.w)];
  vec3 base = record.sun_cutoff.xyz;
  vec3 shadowed = record.middle_gamma.xyz + base * (posed.middle.xyz + posed.slope.xyz * n.z);
  vec3 sunlight = base * posed.sun.xyz * max(0.0, dot(n, posed.sun_direction.xyz));
  float gamma_exponent = posed.gamma_exponent;
#else
  vec3 shadowed = record.middle_gamma.xyz + record.slope_texture.xyz * n.z;
  vec3 sunlight = record.sun_cutoff.xyz * max(0.0, dot(n, record.sun_direction.xyz));
  float gamma_exponent = record.middle_gamma.w;
#endif
  lens = vec4(w_cx.w, x_cy.w, y_fx.w, ray_0_fy.w);
  in_sun_height = vec4(shadowed + sunlight, height);
  in_shadow_gamma = vec4(shadowed, gamma_exponent);
  painted_texture_density = vec4(1.0, record.slope_texture.w, density, record.sun_cutoff.w);
}
#endif

void main() {
  vec3 at = position - eye_offset.xyz;
  vec3 clip = vec3(dot(x_cy.xyz, at), dot(y_fx.xyz, at), dot(w_cx.xyz, at));
  place(clip, (1.0 - clip.z * farness) * nearness_scale, eye_offset.w);
  // A ray d meets the plane at the depth height / (normal . d).
  float height = dot(normal, at);
  nearness = vec3(dot(normal, ray_0_fy.xyz), dot(normal, ray_u_casters.xyz), dot(normal, ray_v_grid.xyz)) / height;
  bool front = height < 0.0;
  vec3 visible = front ? normal : -normal;
#ifdef POSED
  PosedMesh posed = posed_meshes[uint(ray_u_casters.w)];
  visible = mat3(posed.axis_x, posed.axis_y, posed.axis_z) * visible;
  tints_ids = uvec3(0u, 0u, posed.ids);
#else
  tints_ids = uvec3(front ? sunlit.x : sunlit.y, front ? shadowy.x : shadowy.y, ids);
#endif
#ifdef PAINT
  paint(visible, height);
#endif
#ifdef NORMAL
  facing = visible;
#endif
#ifdef SHADOWS
#ifdef POSED
  Camera camera = cameras[posed.camera];
  look_at_sun(camera.eye_offset.xyz, camera.ray_0_fy.xyz, camera.ray_u_casters, camera.ray_v_grid);
#else
  look_at_sun(eye_offset.xyz, ray_0_fy.xyz, ray_u_casters, ray_v_grid);
#endif
#endif
}
)";

// Texture coordinates and neighbouring texels. The code that calls these functions selects the texture.
constexpr const char* kLookup = R"(
float wrapped(float x, uint wrap) {
  float there_and_back = x - 2.0 * floor(0.5 * x);
  float mirrored = there_and_back > 1.0 ? 2.0 - there_and_back : there_and_back;
  return clamp(wrap == 0u ? x - floor(x) : wrap == 1u ? mirrored : x, 0.0, 1.0);
}

// Two neighbouring texels along an axis.
ivec2 neighbours(float below, int size, uint wrap) {
  int first = int(below);
  int second = first + 1;
  if (first < 0) first = wrap == 0u ? size - 1 : 0;
  if (second >= size) second = wrap == 0u ? 0 : size - 1;
  return ivec2(first, second);
}

float mixed(float a, float b, float share) { return a + (b - a) * share; }
)";

constexpr const char* kFlatFragment = R"(
layout(location = 0) flat in vec3 nearness;
layout(location = 1) flat in uvec3 tints_ids;
#ifdef NORMAL
layout(location = 2) flat in vec3 facing;
#endif
#ifdef PAINT
layout(location = 3) in vec2 texture_at;
layout(location = 4) flat in vec4 lens;
layout(location = 5) flat in vec4 in_sun_height;
layout(location = 6) flat in vec4 in_shadow_gamma;
layout(location = 7) flat in vec4 painted_texture_density;
layout(location = 8) in vec3 tint;

layout(std430, binding = 1) readonly buffer Texels { uint texels[]; };  // begin with the linear values of bytes, as floats
// A texture has its first level, number of levels and wrap modes; a level its first texel, width and height.
layout(std430, binding = 2) readonly buffer Textures { uvec4 textures[]; };

vec3 linear_texel(uint offset, int row, int column, int width) {
  uint texel = texels[offset + uint(row * width + column)];
  return vec3(uintBitsToFloat(texels[texel & 0xFFu]), uintBitsToFloat(texels[texel >> 8u & 0xFFu]),
              uintBitsToFloat(texels[texel >> 16u & 0xFFu]));
}

vec3 level_color(uint level, vec2 at, uvec2 wrap) {
  uvec4 place = textures[level];
  ivec2 size = ivec2(place.yz);
  vec2 texel = at * vec2(size) - 0.5;
  vec2 below = floor(texel);
  vec2 towards = texel - below;
  ivec2 x = neighbours(below.x, size.x, wrap.x);
  ivec2 y = neighbours(below.y, size.y, wrap.y);
  vec3 upper = mix(linear_texel(place.x, y.x, x.x, size.x), linear_texel(place.x, y.x, x.y, size.x), towards.x);
  vec3 lower = mix(linear_texel(place.x, y.y, x.x, size.x), linear_texel(place.x, y.y, x.y, size.x), towards.x);
  return mix(upper, lower, towards.y);
}

#ifdef MASK
// See masks.hpp.
bool is_seen_through() {
  if (painted_texture_density.w == 0.0) return false;
  uvec4 image = textures[uint(painted_texture_density.y) - 1u];
  uvec4 place = textures[image.x];
  ivec2 size = ivec2(place.yz);
  vec2 texel = vec2(wrapped(texture_at.x, image.z), wrapped(texture_at.y, image.w)) * vec2(size) - 0.5;
  vec2 below = floor(texel);
  vec2 towards = texel - below;
  ivec2 x = neighbours(below.x, size.x, image.z);
  ivec2 y = neighbours(below.y, size.y, image.w) * size.x;
  float upper = mixed(float(texels[place.x + uint(y.x + x.x)] >> 24u), float(texels[place.x + uint(y.x + x.y)] >> 24u), towards.x);
  float lower = mixed(float(texels[place.x + uint(y.y + x.x)] >> 24u), float(texels[place.x + uint(y.y + x.y)] >> 24u), towards.x);
  return mixed(upper, lower, towards.y) < painted_texture_density.w;
}
#endif

// See textures.hpp.
vec3 texture_color(float depth, vec3 at) {
  uvec4 image = textures[uint(painted_texture_density.y) - 1u];
  vec2 ray = (lens.xy - at.yz) * lens.zw;
  float square = depth * depth / in_sun_height.w;
  float covered = painted_texture_density.z * lens.z * lens.w * (1.0 + dot(ray, ray)) * square * square;
  float detail = 0.5 * (float(floatBitsToInt(covered)) * exp2(-23.0) - 127.0);
  detail = clamp(detail, 0.0, float(image.y - 1u));
  uint fine = uint(detail);
  vec2 place = vec2(wrapped(texture_at.x, image.z), wrapped(texture_at.y, image.w));
  return mix(level_color(image.x + fine, place, image.zw),
             level_color(image.x + min(fine + 1u, image.y - 1u), place, image.zw), detail - float(fine));
}
#endif

void main() {
#if defined(MASK) && defined(PAINT)
  if (is_seen_through()) discard;
#endif
#ifdef COLOR
  bool sun = true;
#if defined(SHADOWS) || defined(PAINT)
  vec3 at = pixel();
  float depth = 1.0 / dot(nearness, at);
#endif
#ifdef SHADOWS
  bool matters = tints_ids.x != tints_ids.y;
#ifdef PAINT
  matters = matters || (painted_texture_density.x > 0.0 && in_sun_height.xyz != in_shadow_gamma.xyz);
#endif
  sun = !in_shadow(depth, at, matters);
#endif
  out_color = unpackUnorm4x8(sun ? tints_ids.x : tints_ids.y);
#ifdef PAINT
  if (painted_texture_density.x > 0.0) {
    vec3 shown = (sun ? in_sun_height.xyz : in_shadow_gamma.xyz) * tint;
    if (painted_texture_density.y > 0.0) shown *= texture_color(depth, at);
    out_color = encode(through_fog(shown, depth, at), in_shadow_gamma.w);
  }
#endif
#endif
#ifdef DEPTH
  gl_FragDepth = (dot(nearness, pixel()) - farness) * nearness_scale;
#endif
#ifdef IDS
  out_ids = uvec2(tints_ids.z & 0xFFFFu, tints_ids.z >> 16u);
#endif
#ifdef NORMAL
  out_normal = vec4(facing, 0.0);
#endif
}
)";

// Draws flat-sided geometry that covers the shape in the image; its fragments test which rays hit the shape itself. Seen from
// well outside, the geometry is a rectangle between the eye and the shape that just covers it. Otherwise it is a box around
// the shape, of which only the back faces are drawn, because the eye may be inside the box.
constexpr const char* kRoundVertex = R"(
layout(location = 3) uniform int boxes;

struct Shape {
  vec4 center_radius;
  vec4 axis_x_half;
  vec4 axis_y_only_front;
  vec4 axis_z_gamma;
  vec3 middle;
  uint ids;
  vec4 slope_half;  // w: half size of a box along y
  vec4 sun;
  vec4 sun_direction;
};
layout(std430, binding = 0) readonly buffer Cameras { Camera cameras[]; };
layout(std430, binding = 1) readonly buffer VisibleShapes { uvec2 visible_shapes[]; };  // (camera, shape)
layout(std430, binding = 2) readonly buffer Shapes { Shape shapes[]; };

layout(location = 0) flat out vec4 origin_radius;  // of the rays, in the shape's frame
layout(location = 1) flat out vec4 ray_0_half;
layout(location = 2) flat out vec4 ray_u_only_front;  // w of a box: half size along y
layout(location = 3) flat out vec4 ray_v_gamma;
#ifdef COLOR
layout(location = 4) flat out vec3 middle;
layout(location = 5) flat out vec3 slope;
layout(location = 6) flat out vec3 sun;
layout(location = 7) flat out vec3 sun_direction;  // in the shape's frame
layout(location = 8) flat out vec3 up;
#endif
#ifdef IDS
layout(location = 9) flat out uint ids;
#endif
#ifdef NORMAL
layout(location = 16) flat out mat3 to_world;
#endif

vec3 box_corner(int number, vec3 center, mat3 rotation, vec3 extents) {
  vec3 corner = vec3(number & 1, (number >> 1) & 1, (number >> 2) & 1) * 2.0 - 1.0;
  return center + rotation * (corner * extents);
}

vec3 rectangle_corner(int number, vec3 center, mat3 rotation, vec3 extents) {
  vec2 corner = vec2(number & 1, (number >> 1) & 1) * 2.0 - 1.0;
#ifdef DISC
  return center + rotation * vec3(corner * extents.xy, 0.0);
#endif
  float r = extents.x;
#ifdef SPHERE
  // A square across the line to the centre, at the front of the sphere, as wide as the cone of tangents is there.
  float distance = length(center);
  vec3 forward = center / distance;
  vec3 side = normalize(abs(forward.z) < 0.7 ? vec3(-forward.y, forward.x, 0.0) : vec3(0.0, -forward.z, forward.y));
  float front = distance - r;
  float width = front * r * inversesqrt(distance * distance - r * r);
  return front * forward + width * (corner.x * side + corner.y * cross(forward, side));
#else
  // A rectangle along the axis, at the front of the cylinder, as wide as the wedge of tangents is there. A rim above the eye
  // appears highest at its front, a rim below the eye at its back.
  vec3 axis = rotation[2];
  float middle = dot(center, axis);
  vec3 across = center - middle * axis;
  float distance = length(across);
  vec3 forward = across / distance;
  float front = distance - r;
  float width = front * r * inversesqrt(distance * distance - r * r);
  float rim = middle + corner.y * extents.z;
  float height = rim * corner.y > 0.0 ? rim : rim * front / (distance + r);
  return front * forward + corner.x * width * cross(forward, axis) + height * axis;
#endif
}

void main() {
  uvec2 visible = visible_shapes[gl_VertexID >> (boxes == 1 ? 3 : 2)];
  Camera camera = cameras[visible.x];
  Shape shape = shapes[visible.y];
  mat3 rotation = mat3(shape.axis_x_half.xyz, shape.axis_y_only_front.xyz, shape.axis_z_gamma.xyz);
  vec3 center = shape.center_radius.xyz - camera.eye_offset.xyz;
  float radius = shape.center_radius.w;
  float half_height = shape.axis_x_half.w;

  // A twentieth of a pixel wider than the shape, so that the rasteriser's rounding drops no pixel of it.
#ifdef BOX
  vec3 half_extents = vec3(radius, shape.slope_half.w, half_height);
  float reach = length(center) + length(half_extents);
#else
  vec3 half_extents = vec3(radius, radius, half_height);
  float reach = length(center) + length(half_extents.yz);
#endif
  vec3 extents = half_extents * 1.0001 + 0.05 * reach * max(camera.y_fx.w, camera.ray_0_fy.w);
  vec3 at = boxes == 1 ? box_corner(gl_VertexID & 7, center, rotation, extents)
                       : rectangle_corner(gl_VertexID & 3, center, rotation, extents);
  // The near and far planes must not clip this: it may lie in front of the near plane while the visible surface behind it does
  // not. Only the plane of the eye clips it.
  place(vec3(dot(camera.x_cy.xyz, at), dot(camera.y_fx.xyz, at), dot(camera.w_cx.xyz, at)), 0.01 * near, camera.eye_offset.w);

  origin_radius = vec4(-center * rotation, radius);
  ray_0_half = vec4(camera.ray_0_fy.xyz * rotation, half_height);
#ifdef BOX
  ray_u_only_front = vec4(camera.ray_u_casters.xyz * rotation, shape.slope_half.w);
#else
  ray_u_only_front = vec4(camera.ray_u_casters.xyz * rotation, shape.axis_y_only_front.w);
#endif
  ray_v_gamma = vec4(camera.ray_v_grid.xyz * rotation, shape.axis_z_gamma.w);
#ifdef COLOR
  middle = shape.middle;
  slope = shape.slope_half.xyz;
  sun = shape.sun.xyz;
  sun_direction = shape.sun_direction.xyz * rotation;
  up = vec3(rotation[0].z, rotation[1].z, rotation[2].z);
#endif
#ifdef IDS
  ids = shape.ids;
#endif
#ifdef NORMAL
  to_world = rotation;
#endif
#ifdef SHADOWS
  look_at_sun(camera.eye_offset.xyz, camera.ray_0_fy.xyz, camera.ray_u_casters, camera.ray_v_grid);
#endif
}
)";

constexpr const char* kRoundInputs = R"(
layout(location = 0) flat in vec4 origin_radius;
layout(location = 1) flat in vec4 ray_0_half;
layout(location = 2) flat in vec4 ray_u_only_front;
layout(location = 3) flat in vec4 ray_v_gamma;
#ifdef COLOR
layout(location = 4) flat in vec3 middle;
layout(location = 5) flat in vec3 slope;
layout(location = 6) flat in vec3 sun;
layout(location = 7) flat in vec3 sun_direction;
layout(location = 8) flat in vec3 up;
#endif
#ifdef IDS
layout(location = 9) flat in uint ids;
#endif
#ifdef NORMAL
layout(location = 16) flat in mat3 to_world;
#endif
)";

// Each function returns the interval of t in which the line o + t d is inside a shape; it is empty if the first value is the
// larger one. The distance of a line from a centre comes from a cross product. The alternative o.o - (o.d)^2 / d.d is a
// difference of large numbers if the shape is thin and far away.
constexpr const char* kLines = R"(
const vec2 nowhere = vec2(1e30, -1e30);

vec2 roots(float o_dot_d, float d_dot_d, float cross_squared, float radius) {
  float square = radius * radius * d_dot_d - cross_squared;
  float half_chord = sqrt(max(square, 0.0));
  return square >= 0.0 ? vec2(-o_dot_d - half_chord, half_chord - o_dot_d) / d_dot_d : nowhere;
}

vec2 ball(vec3 o, vec3 d, float radius) {
  vec3 across = cross(o, d);
  return roots(dot(o, d), dot(d, d), dot(across, across), radius);
}

vec2 circle(vec2 o, vec2 d, float radius) {
  float across = o.x * d.y - o.y * d.x;
  float d_dot_d = dot(d, d);
  vec2 parallel = dot(o, o) <= radius * radius ? -nowhere : nowhere;  // rays parallel to the axis hit always or never
  return d_dot_d <= 1e-24 ? parallel : roots(dot(o, d), d_dot_d, across * across, radius);
}

vec2 slab(float o, float d, float height) {
  vec2 parallel = abs(o) <= height ? -nowhere : nowhere;
  float middle = -o / d;
  float around = height / abs(d);
  return d == 0.0 ? parallel : vec2(middle - around, middle + around);
}

vec2 intersection(vec2 a, vec2 b) { return vec2(max(a.x, b.x), min(a.y, b.y)); }

vec2 hull(vec2 a, vec2 b) { return vec2(min(a.x, b.x), max(a.y, b.y)); }

vec2 capsule(vec3 o, vec3 d, float radius, float half_height) {
  vec3 up = vec3(0.0, 0.0, half_height - radius);
  vec2 body = intersection(circle(o.xy, d.xy, radius), slab(o.z, d.z, up.z));
  if (body.x > body.y) body = nowhere;
  return hull(hull(body, ball(o - up, d, radius)), ball(o + up, d, radius));
}
)";

// Returns whether something hides the sun from the point that a pixel shows at this depth; see GlSunGrid. Tests nothing if
// the result does not matter.
constexpr const char* kShadows = R"(
#ifdef SHADOWS
layout(location = 11) flat in vec4 sun_eye_left;
layout(location = 12) flat in vec4 sun_ray_0_low;
layout(location = 13) flat in vec4 sun_ray_u_cells;
layout(location = 14) flat in vec3 sun_ray_v;
layout(location = 15) flat in uvec4 sun_grid;

layout(std430, binding = 4) readonly buffer Starts { uint starts[]; };
layout(std430, binding = 5) readonly buffer Entries { uint entries[]; };
layout(std430, binding = 6) readonly buffer Casters { mat4 casters[]; };  // columns are what GlSunGrid calls rows
#ifdef BODIES
layout(location = 10) flat in uint first_body_caster;
layout(std430, binding = 8) readonly buffer BodyCasters { mat4 body_casters[]; };  // lists with an empty caster at the end
#endif
#ifdef MESHES
struct CasterNode {
  vec3 low;
  uint next;
  vec3 high;
  uint triangles;
};
layout(std430, binding = 9) readonly buffer CasterNodes { CasterNode caster_nodes[]; };
#endif

#ifdef MASK
float mask_alpha(uint first, int texel) {
  return float(entries[first + uint(texel >> 2)] >> uint(8 * (texel & 3)) & 0xFFu);
}

// Returns whether the sun shines through a triangle at these weights of its second and third corner; see masks.hpp.
bool is_shone_through(mat4 triangle, float b, float c, uint first_mask) {
  mat4 mask = casters[first_mask + uint(triangle[0].w) - 1u];
  uvec2 wrap = uvec2(mask[0].zw);
  ivec2 size = ivec2(mask[0].xy);
  uint first = uint(mask[1].x) << 16u | uint(mask[1].y);
  vec2 place = triangle[2].zw + b * triangle[3].xy + c * triangle[3].zw;
  vec2 texel = vec2(wrapped(place.x, wrap.x), wrapped(place.y, wrap.y)) * vec2(size) - 0.5;
  vec2 below = floor(texel);
  vec2 towards = texel - below;
  ivec2 x = neighbours(below.x, size.x, wrap.x);
  ivec2 y = neighbours(below.y, size.y, wrap.y) * size.x;
  float upper = mixed(mask_alpha(first, y.x + x.x), mask_alpha(first, y.x + x.y), towards.x);
  float lower = mixed(mask_alpha(first, y.y + x.x), mask_alpha(first, y.y + x.y), towards.x);
  return mixed(upper, lower, towards.y) < mask[1].z;
}
#endif

// Returns whether a solid lies above the point.
bool is_above(mat4 solid, vec3 p) {
  mat3 to_solid = transpose(mat3(solid[1].xyz, solid[2].xyz, solid[3].xyz));
  vec3 half_extents = vec3(solid[1].w, solid[2].w, solid[3].w);
  vec3 o = to_solid * (p - solid[0].xyz);
  vec3 d = to_solid[2];
  int kind = int(solid[0].w);
  vec2 inside;
  if (kind == 1 || kind == 5) {
    inside = intersection(slab(o.x, d.x, half_extents.x), slab(o.y, d.y, half_extents.y));
    inside = intersection(inside, slab(o.z, d.z, half_extents.z));
  } else if (kind == 2) {
    inside = intersection(circle(o.xy, d.xy, half_extents.x), slab(o.z, d.z, half_extents.z));
  } else if (kind == 3) {
    inside = ball(o, d, half_extents.x);
  } else {
    inside = capsule(o, d, half_extents.x, half_extents.z);
  }
  return inside.x <= inside.y && (kind == 5 ? inside.x : inside.y) >= 0.0;  // a room hides only from outside
}

#ifdef MESHES
// Returns whether a triangle of a mesh lies above the point; see GlCasterTree.
bool mesh_is_above(mat4 mesh, vec3 p) {
  mat3 to_mesh = transpose(mat3(mesh[1].xyz, mesh[2].xyz, mesh[3].xyz));
  vec3 d = to_mesh[2];
  vec3 o = to_mesh * (p - mesh[0].xyz);
  // Begins where the ray passes the centre of the ball, because numbers are most accurate there. The point lies at `below`.
  float below = dot(o, d);
  o -= below * d;
  float radius = mesh[1].w * 1.0001;
  if (dot(o, o) > radius * radius || below > radius) return false;
  vec3 safe = vec3(abs(d.x) > 1e-12 ? d.x : 1e-12, abs(d.y) > 1e-12 ? d.y : 1e-12, abs(d.z) > 1e-12 ? d.z : 1e-12);
  vec3 slope = 1.0 / safe;
  uint node = uint(mesh[2].w) << 16u | uint(mesh[3].w);
  uint end = caster_nodes[node].next;
  bool hidden = false;
  while (node < end && !hidden) {
    CasterNode box = caster_nodes[node];
    vec3 a = (box.low - o) * slope;
    vec3 b = (box.high - o) * slope;
    vec3 enter = min(a, b);
    vec3 leave = max(a, b);
    float last = min(leave.x, min(leave.y, leave.z));
    bool reached = max(enter.x, max(enter.y, enter.z)) <= last && last >= below;
    uint next = reached ? box.triangles >> 3u : 0u;
    uint stop = next + (reached ? box.triangles & 7u : 0u);
    for (; next < stop && !hidden; ++next) {
      mat4 triangle = casters[next];
      vec3 from_corner = o - triangle[0].xyz;
      vec3 to_second = triangle[1].xyz;
      vec3 to_third = vec3(triangle[1].w, triangle[2].xy);
      vec3 across = cross(d, to_third);
      vec3 turned = cross(from_corner, to_second);
      float area = dot(to_second, across);
      float b = dot(from_corner, across) / area;
      float c = dot(d, turned) / area;
      hidden = area != 0.0 && b >= 0.0 && c >= 0.0 && b + c <= 1.0 && dot(to_third, turned) / area >= below;
#ifdef MASK
      if (hidden && triangle[0].w > 0.0) hidden = !is_shone_through(triangle, b, c, 0u);
#endif
    }
    node = reached ? node + 1u : box.next;
  }
  return hidden;
}
#endif

bool in_shadow(float depth, vec3 at, bool faces_sun) {
  vec3 ray = sun_ray_0_low.xyz + sun_ray_u_cells.xyz * at.y + sun_ray_v * at.z;
  vec3 p = sun_eye_left.xyz + depth * ray;
  // Moves the point off the surface by more than its rounding error: back along the ray, and towards the sun.
  float lift = 1e-4 * (1.0 + max(abs(p.x), max(abs(p.y), abs(p.z))));
  p += lift * (vec3(0.0, 0.0, 1.0) - normalize(ray));
  vec2 cell = floor((p.xy - vec2(sun_eye_left.w, sun_ray_0_low.w)) * sun_ray_u_cells.w);
  bool matters = faces_sun && all(greaterThanEqual(cell, vec2(0.0))) && all(lessThan(cell, vec2(sun_grid.xy)));
  uint list = sun_grid.z + (matters ? uint(cell.y) * sun_grid.x + uint(cell.x) : 0u) * 2u;
  uint next = starts[list];
  uint solids = matters ? starts[list + 1u] : next;
  uint end = matters ? starts[list + 2u] : next;
  bool hidden = false;
  for (; next < solids && !hidden; ++next) {
    mat4 triangle = casters[entries[next]];
    vec2 from_corner = p.xy - triangle[0].xy;
    float b = dot(from_corner, triangle[1].xy);
    float c = dot(from_corner, triangle[1].zw);
    hidden = b >= 0.0 && c >= 0.0 && b + c <= 1.0 && triangle[0].z + b * triangle[2].x + c * triangle[2].y > p.z;
#ifdef MASK
    if (hidden && triangle[0].w > 0.0) hidden = !is_shone_through(triangle, b, c, sun_grid.w);
#endif
  }
  for (next = solids; next < end && !hidden; ++next) {
    hidden = is_above(casters[entries[next]], p);
  }
#ifdef BODIES
  for (next = faces_sun ? first_body_caster : 0u; !hidden && body_casters[next][0].w > 0.0; ++next) {
#ifdef MESHES
    if (body_casters[next][0].w == 6.0) {
      hidden = mesh_is_above(body_casters[next], p);
      continue;
    }
#endif
    hidden = is_above(body_casters[next], p);
  }
#endif
  return hidden;
}
#endif
)";

// The interval of a ray inside a round shape, and the normal at a point p of its surface.
constexpr const char* kRoundKinds = R"(
#define radius origin_radius.w
#define half_height ray_0_half.w
#ifdef BOX
#define only_front false
#else
#define only_front (ray_u_only_front.w != 0.0)
#endif

#ifdef SPHERE
vec2 interval(vec3 o, vec3 d) { return ball(o, d, radius); }
vec3 surface_normal(vec3 p, vec2 inside, float depth) { return normalize(p); }
#endif

#ifdef CYLINDER
vec2 caps;
vec2 interval(vec3 o, vec3 d) {
  caps = slab(o.z, d.z, half_height);
  return intersection(circle(o.xy, d.xy, radius), caps);
}
vec3 surface_normal(vec3 p, vec2 inside, float depth) {
  bool cap = depth == inside.x ? inside.x == caps.x : inside.y == caps.y;
  return cap ? vec3(0.0, 0.0, sign(p.z)) : vec3(normalize(p.xy), 0.0);
}
#endif

#ifdef CAPSULE
vec2 interval(vec3 o, vec3 d) { return capsule(o, d, radius, half_height); }
vec3 surface_normal(vec3 p, vec2 inside, float depth) {
  float middle = half_height - radius;
  return normalize(p - vec3(0.0, 0.0, clamp(p.z, -middle, middle)));
}
#endif

#ifdef DISC
vec2 interval(vec3 o, vec3 d) {
  float depth = -o.z / d.z;
  vec2 at = o.xy + depth * d.xy;
  return dot(at, at) <= radius * radius ? vec2(depth) : nowhere;
}
vec3 surface_normal(vec3 p, vec2 inside, float depth) { return vec3(0.0, 0.0, 1.0); }
#endif

#ifdef BOX
#define half_y ray_u_only_front.w
vec2 interval(vec3 o, vec3 d) {
  return intersection(intersection(slab(o.x, d.x, radius), slab(o.y, d.y, half_y)), slab(o.z, d.z, half_height));
}
vec3 surface_normal(vec3 p, vec2 inside, float depth) {
  vec3 outside = abs(p) - vec3(radius, half_y, half_height);
  if (outside.z > max(outside.x, outside.y)) return vec3(0.0, 0.0, 1.0);
  return outside.y > outside.x ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0);
}
#endif
)";

constexpr const char* kRoundMain = R"(
void main() {
  vec3 at = pixel();
  vec3 ray = ray_0_half.xyz + ray_u_only_front.xyz * at.y + ray_v_gamma.xyz * at.z;
  vec2 inside = interval(origin_radius.xyz, ray);
  float depth = inside.x;
  if (!(depth >= near) && !only_front) depth = inside.y;
  if (!(inside.x <= inside.y && depth >= near && depth <= far)) discard;
  gl_FragDepth = (1.0 / depth - farness) * nearness_scale;
#if defined(COLOR) || defined(NORMAL)
  vec3 normal = surface_normal(origin_radius.xyz + depth * ray, inside, depth);
  if (dot(normal, ray) > 0.0) normal = -normal;
#endif
#ifdef COLOR
  float sunward = max(0.0, dot(normal, sun_direction));
#ifdef SHADOWS
  if (in_shadow(depth, at, sunward > 0.0)) sunward = 0.0;
#endif
  vec3 light = middle + slope * dot(normal, up) + sun * sunward;
  out_color = encode(through_fog(light, depth, at), ray_v_gamma.w);
#endif
#ifdef IDS
  out_ids = uvec2(ids & 0xFFFFu, ids >> 16u);
#endif
#ifdef NORMAL
  out_normal = vec4(to_world * normal, 0.0);
#endif
}
)";

// The sky, drawn where the depth buffer still has its clear value.
constexpr const char* kSkyVertex = R"(
layout(std430, binding = 0) readonly buffer Cameras { Camera cameras[]; };
layout(location = 0) flat out vec4 ray_0_gamma;
layout(location = 1) flat out vec3 ray_u;
layout(location = 2) flat out vec3 ray_v;
layout(location = 3) flat out vec3 horizon;
layout(location = 4) flat out vec3 zenith;
#ifdef SUN
layout(location = 5) flat out vec4 sun_edge;
layout(location = 6) flat out vec4 disc_steepness;
layout(location = 7) flat out float glow;
#endif

void main() {
  Camera camera = cameras[gl_VertexID >> 2];
#ifdef SUN
  sun_edge = camera.sun_edge;
  disc_steepness = camera.disc_steepness;
  glow = camera.zenith_glow.w;
#endif
  place(vec3(vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) * 2.0 - 1.0, 1.0), 0.0, camera.eye_offset.w);
  ray_0_gamma = vec4(camera.ray_0_fy.xyz, camera.horizon.w);
  ray_u = camera.ray_u_casters.xyz;
  ray_v = camera.ray_v_grid.xyz;
  horizon = camera.horizon.xyz;
  zenith = camera.zenith_glow.xyz;
}
)";

constexpr const char* kSkyFragment = R"(
layout(location = 0) flat in vec4 ray_0_gamma;
layout(location = 1) flat in vec3 ray_u;
layout(location = 2) flat in vec3 ray_v;
layout(location = 3) flat in vec3 horizon;
layout(location = 4) flat in vec3 zenith;
#ifdef SUN
layout(location = 5) flat in vec4 sun_edge;
layout(location = 6) flat in vec4 disc_steepness;
layout(location = 7) flat in float glow;
#endif

void main() {
  vec3 at = pixel();
  vec3 ray = ray_0_gamma.xyz + ray_u * at.y + ray_v * at.z;
  vec3 color = mix(horizon, zenith, max(0.0, ray.z) / length(ray));
#ifdef SUN
  vec3 apart = ray / length(ray) - sun_edge.xyz;
  float q = dot(apart, apart);
  float disc = min((sun_edge.w - q) * disc_steepness.w, 1.0);
  color = mix(color, disc_steepness.xyz, max(disc, glow / (1.0 + sun_focus * q)));
#endif
  out_color = encode(color, ray_0_gamma.w);
#ifdef IDS
  out_ids = uvec2(0u);
#endif
#ifdef NORMAL
  out_normal = vec4(0.0);
#endif
}
)";

constexpr const char* kResolveVertex = R"(
out gl_PerVertex { vec4 gl_Position; };
void main() { gl_Position = vec4((gl_VertexID & 1) * 4.0 - 1.0, (gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }
)";

constexpr const char* kResolveFragment = R"(
layout(location = 2) uniform int side;
layout(binding = 0) uniform sampler2D samples;

void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * side;
  ivec3 sum = ivec3(0);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) sum += ivec3(texelFetch(samples, first + ivec2(x, y), 0).rgb * 255.0 + 0.5);
  }
  int count = side * side;
  out_color = vec4(vec3((sum * 2 + count) / (2 * count)) / 255.0, 1.0);
}
)";

GlShader compile(GLenum stage, const std::string& defines, std::initializer_list<const char*> parts) {
  std::string source = kCommon;
  source.insert(source.find('\n') + 1, defines);
  for (const char* part : parts) source += part;
  GlShader shader = GlShader::make(stage);
  const char* text = source.c_str();
  glShaderSource(shader.name(), 1, &text, nullptr);
  glCompileShader(shader.name());
  GLint compiled = GL_FALSE;
  glGetShaderiv(shader.name(), GL_COMPILE_STATUS, &compiled);
  if (compiled == GL_TRUE) return shader;
  std::array<char, 2048> log{};
  glGetShaderInfoLog(shader.name(), static_cast<GLsizei>(log.size()), nullptr, log.data());
  throw GlUnavailable("the driver rejected a shader: " + std::string(log.data()));
}

GlProgram link(const GlShader& vertex, const GlShader& fragment) {
  GlProgram program = GlProgram::make();
  glAttachShader(program.name(), vertex.name());
  glAttachShader(program.name(), fragment.name());
  glLinkProgram(program.name());
  GLint linked = GL_FALSE;
  glGetProgramiv(program.name(), GL_LINK_STATUS, &linked);
  if (linked == GL_TRUE) return program;
  std::array<char, 2048> log{};
  glGetProgramInfoLog(program.name(), static_cast<GLsizei>(log.size()), nullptr, log.data());
  throw GlUnavailable("the driver rejected a program: " + std::string(log.data()));
}

}  // namespace

GLuint GlShaders::get(Role role, const ShaderTraits& traits) {
  static constexpr std::array kDefines{
      "", "#define POSED\n", "#define CYLINDER\n", "#define SPHERE\n", "#define CAPSULE\n", "#define DISC\n", "#define BOX\n", "",
      ""};
  const std::array flags{traits.writes.color, traits.writes.depth,
                         traits.writes.ids,   traits.writes.normal,
                         traits.shadows,      traits.painted && (traits.writes.color || traits.masked),
                         traits.sun,          traits.masked,
                         traits.bodies,       traits.air && traits.writes.color,
                         traits.meshes};
  static const std::array<std::string, flags.size()> kFlagDefines{
      "#define COLOR\n",
      "#define DEPTH\n",
      "#define IDS\n",
      "#define NORMAL\n",
      "#define SHADOWS\n",
      "#define PAINT\n",
      "#define SUN\n#define sun_focus " + std::to_string(SunDisc::kFocus) + '\n',
      "#define MASK\n",
      "#define BODIES\n",
      "#define AIR\n",
      "#define MESHES\n"};
  auto key = static_cast<std::uint32_t>(role);
  std::string defines;
  for (std::size_t i = 0; i < flags.size(); ++i) key |= (flags[i] ? 1U : 0U) << (8U + static_cast<std::uint32_t>(i));
  if (const auto found = programs_.find(key); found != programs_.end()) return found->second.name();
  for (std::size_t i = 0; i < flags.size(); ++i) {
    if (flags[i]) defines += kFlagDefines[i];
  }
  defines += kDefines[static_cast<std::size_t>(role)];
  const auto make = [&](std::initializer_list<const char*> vertex, std::initializer_list<const char*> fragment) -> GlProgram {
    return link(compile(GL_VERTEX_SHADER, defines, vertex), compile(GL_FRAGMENT_SHADER, defines, fragment));
  };
  GlProgram program;
  switch (role) {
    case Role::flat:
    case Role::posed:
      program = make({kVertexCommon, kFlatVertex}, {kFragmentCommon, kLookup, kLines, kShadows, kFlatFragment});
      break;
    case Role::sky:
      program = make({kVertexCommon, kSkyVertex}, {kFragmentCommon, kSkyFragment});
      break;
    case Role::resolve:
      program = make({kResolveVertex}, {kFragmentCommon, kResolveFragment});
      break;
    default:
      program = make({kVertexCommon, kRoundVertex},
                     {kFragmentCommon, kLookup, kLines, kShadows, kRoundInputs, kRoundKinds, kRoundMain});
      break;
  }
  return programs_.emplace(key, std::move(program)).first->second.name();
}

GLuint GlShaders::flat(const ShaderTraits& traits) { return get(Role::flat, traits); }

GLuint GlShaders::posed(const ShaderTraits& all_traits) {
  ShaderTraits traits = all_traits;
  traits.painted = true;
  return get(Role::posed, traits);
}

GLuint GlShaders::round(RoundKind kind, const ShaderTraits& all_traits) {
  ShaderTraits traits = all_traits;
  traits.painted = false;
  traits.masked = all_traits.masked && all_traits.shadows;  // masks affect round shapes only through shadows
  switch (kind) {
    case RoundKind::cylinder:
      return get(Role::cylinder, traits);
    case RoundKind::sphere:
      return get(Role::sphere, traits);
    case RoundKind::capsule:
      return get(Role::capsule, traits);
    case RoundKind::disc:
      return get(Role::disc, traits);
    default:
      return get(Role::box, traits);
  }
}

GLuint GlShaders::sky(const ShaderTraits& traits) { return get(Role::sky, {.writes = traits.writes, .sun = traits.sun}); }

GLuint GlShaders::resolve() { return get(Role::resolve, {.writes = {.color = true}}); }

}  // namespace flockstep::render
