#include "render/gl/shaders.hpp"

#include <string>

#include "render/appearance.hpp"
#include "render/gl/egl_context.hpp"

namespace flockstep::render {
namespace {

// Declarations shared by all shaders. Tiles are stacked vertically in the atlas. Row 0 of a tile, the top of its image, has the
// lowest y. The depth buffer holds (1 / depth - 1 / far) / (1 / near - 1 / far), which is 1 at the near plane and 0 at the far
// plane. This value is as accurate as the depth itself at every distance, and triangles interpolate it linearly. Depth images
// are read from this buffer.
constexpr const char* kCommon = R"(#version 450 core
layout(location = 0) uniform vec4 tiles;
layout(location = 1) uniform vec4 range;
#define farness range.x
#define nearness_scale range.y

struct View {
  vec4 eye_middle;
  vec4 w, x, y;
  vec4 ray_0, ray_u, ray_v;
  vec4 turn_x, turn_y, turn_z;
  vec4 scale;
  vec3 color;
  uint ids;
  vec4 middle_gamma, slope;
  vec4 sun, sun_direction;
  vec4 horizon, zenith_glow;
  vec4 disc_steepness;
  float edge;
  uint first_color;
};
layout(std430, binding = 0) readonly buffer Views { View views[]; };
)";

constexpr const char* kVertex = R"(
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 uv;
layout(location = 2) in vec3 color;
layout(location = 3) in uvec2 draw;  // its first triangle, and the view

layout(location = 0) flat out vec3 corner;  // a point of the triangle relative to the eye
layout(location = 1) flat out uvec2 drawn;
layout(location = 2) out vec2 texture_at;
layout(location = 3) out vec3 tint;
out gl_PerVertex {
  vec4 gl_Position;
  float gl_ClipDistance[2];
};

void main() {
  vec4 scale = views[draw.y].scale;
  vec3 at = scale.xyz * position - views[draw.y].eye_middle.xyz;
  at.z += scale.w * sign(position.z);
  float w = dot(views[draw.y].w.xyz, at);
  float y = dot(views[draw.y].y.xyz, at);
  // A tile is as wide as the atlas; other tiles lie above and below it.
  gl_Position = vec4(dot(views[draw.y].x.xyz, at), y * tiles.z + w * views[draw.y].eye_middle.w,
                     (1.0 - w * farness) * nearness_scale, w);
  gl_ClipDistance[0] = w + y;
  gl_ClipDistance[1] = w - y;
  corner = at;
  drawn = draw;
  texture_at = uv;
  tint = color;
}
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

// The ray through this pixel.
#define pixel_ray(view) \
  (view.ray_0.xyz + view.ray_u.xyz * gl_FragCoord.x + \
   view.ray_v.xyz * (gl_FragCoord.y - tiles.x * floor(gl_FragCoord.y * tiles.y)))

vec4 encode(vec3 light, float gamma_exponent) {
  return vec4(floor(255.0 * pow(min(light, 1.0), vec3(gamma_exponent)) + 0.5) / 255.0, 1.0);
}
)";

constexpr const char* kFragment = R"(
layout(location = 0) flat in vec3 corner;
layout(location = 1) flat in uvec2 drawn;
layout(location = 2) in vec2 texture_at;
layout(location = 3) in vec3 tint;

struct Triangle {
  vec3 normal;
  uint ids;
  uint material;
  float density;
  uint texture_number;
  float cutoff;
};
layout(std430, binding = 1) readonly buffer Triangles { Triangle triangles[]; };
layout(std430, binding = 2) readonly buffer Colors { vec4 colors[]; };  // of each material: base colour, emission

#if defined(TEXTURED) || defined(MASKED)
layout(std430, binding = 3) readonly buffer Texels { uint texels[]; };  // begin with the linear values of bytes, as floats
// A texture has its first level, number of levels and wrap modes; a level its first texel, width, height and stride.
layout(std430, binding = 4) readonly buffer Textures { uvec4 textures[]; };

float wrapped(float x, uint wrap) {
  float there_and_back = x - 2.0 * floor(0.5 * x);
  float mirrored = there_and_back > 1.0 ? 2.0 - there_and_back : there_and_back;
  return clamp(wrap == 0u ? x - floor(x) : wrap == 1u ? mirrored : x, 0.0, 1.0);
}

vec4 texel_at(int number) {
  uint texel = texels[number];
  return vec4(uintBitsToFloat(texels[texel & 0xFFu]), uintBitsToFloat(texels[texel >> 8u & 0xFFu]),
              uintBitsToFloat(texels[texel >> 16u & 0xFFu]), float(texel >> 24u));
}

// The linear colour of a level of a texture, and its alpha in [0, 255].
vec4 level_color(uint level, uvec4 image) {
  uvec4 place = textures[image.x + level];
  vec2 texel = vec2(wrapped(texture_at.x, image.z), wrapped(texture_at.y, image.w)) * vec2(place.yz) - 0.5;
  vec2 below = floor(texel);
  vec2 towards = texel - below;
  int stride = int(place.w);
  int first = int(place.x) + int(below.y) * stride + int(below.x);
  vec4 upper = mix(texel_at(first), texel_at(first + 1), towards.x);
  vec4 lower = mix(texel_at(first + stride), texel_at(first + stride + 1), towards.x);
  return mix(upper, lower, towards.y);
}

// See textures.hpp. covered: number of texels that the pixel covers.
vec3 texture_color(uvec4 image, float covered) {
  float detail = clamp(0.5 * (float(floatBitsToInt(covered)) * exp2(-23.0) - 127.0), 0.0, float(image.y - 1u));
  uint fine = uint(detail);
  return mix(level_color(fine, image), level_color(min(fine + 1u, image.y - 1u), image), detail - float(fine)).rgb;
}
#endif

void main() {
  Triangle shown = triangles[drawn.x + uint(gl_PrimitiveID)];
#ifdef MASKED  // see masks.hpp
  if (shown.cutoff > 0.0 && level_color(0u, textures[shown.texture_number - 1u]).a < shown.cutoff) discard;
#endif
#define view views[drawn.y]
  // A ray meets the plane of the triangle at the depth height / (normal . ray).
  vec3 ray = pixel_ray(view);
  float height = dot(shown.normal, corner);
  float nearness = dot(shown.normal, ray) / height;
#ifdef DEPTH
  gl_FragDepth = (nearness - farness) * nearness_scale;
#endif
#if defined(COLOR) || defined(NORMAL)
  vec3 normal = mat3(view.turn_x.xyz, view.turn_y.xyz, view.turn_z.xyz) * (height < 0.0 ? shown.normal : -shown.normal);
#endif
#ifdef COLOR
  vec3 light = view.middle_gamma.xyz + view.slope.xyz * normal.z +
               view.sun.xyz * max(0.0, dot(normal, view.sun_direction.xyz));
  uint material = view.first_color + 2u * shown.material;
  vec3 color = (colors[material].xyz * view.color * light + colors[material + 1u].xyz) * tint;
#ifdef TEXTURED
  if (shown.texture_number != 0u) {
    float stretch = 1.0 / (nearness * nearness * height);
    float pixel_area = length(view.ray_u.xyz) * length(view.ray_v.xyz);
    float covered = shown.density * pixel_area * dot(ray, ray) * stretch * stretch;
    color *= texture_color(textures[shown.texture_number - 1u], covered);
  }
#endif
  out_color = encode(color, view.middle_gamma.w);
#endif
#ifdef IDS
  uint ids = view.ids != 0u ? view.ids : shown.ids;
  out_ids = uvec2(ids & 0xFFFFu, ids >> 16u);
#endif
#ifdef NORMAL
  out_normal = vec4(normal, 0.0);
#endif
}
)";

constexpr const char* kEverywhereVertex = R"(
out gl_PerVertex { vec4 gl_Position; };
void main() { gl_Position = vec4((gl_VertexID & 1) * 4.0 - 1.0, (gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }
)";

// The first views are those of the cameras, one per tile.
constexpr const char* kSkyFragment = R"(
void main() {
#define view views[uint(gl_FragCoord.y * tiles.y)]
  vec3 ray = normalize(pixel_ray(view));
  vec3 color = mix(view.horizon.xyz, view.zenith_glow.xyz, max(0.0, ray.z));
  vec3 apart = ray - view.sun_direction.xyz;
  float q = dot(apart, apart);
  float disc = clamp((view.edge - q) * view.disc_steepness.w, 0.0, 1.0);
  color = mix(color, view.disc_steepness.xyz, max(disc, view.zenith_glow.w / (1.0 + sun_focus * q)));
  out_color = encode(color, view.middle_gamma.w);
#ifdef IDS
  out_ids = uvec2(0u);
#endif
#ifdef NORMAL
  out_normal = vec4(0.0);
#endif
}
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

GlObject compile(GLenum stage, const std::string& defines, std::initializer_list<const char*> parts) {
  std::string source = kCommon;
  source.insert(source.find('\n') + 1, defines);
  for (const char* part : parts) source += part;
  GlObject shader = make_shader(stage);
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

GlObject link(const GlObject& vertex, const GlObject& fragment) {
  GlObject program = make_program();
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
  const Attachments& writes = traits.writes;
  const std::array flags{writes.color, writes.depth, writes.ids, writes.normal, traits.textured && writes.color, traits.masked};
  constexpr std::array<const char*, flags.size()> kNames{"COLOR", "DEPTH", "IDS", "NORMAL", "TEXTURED", "MASKED"};
  auto key = static_cast<std::uint32_t>(role);
  std::string defines = "#define sun_focus " + std::to_string(SunDisc::kFocus) + '\n';
  for (std::size_t i = 0; i < flags.size(); ++i) {
    key = 2 * key + (flags[i] ? 1 : 0);
    if (flags[i]) defines += std::string("#define ") + kNames[i] + '\n';
  }
  if (const auto found = programs_.find(key); found != programs_.end()) return found->second.name();
  const char* const vertex = role == Role::triangles ? kVertex : kEverywhereVertex;
  const char* const fragment = role == Role::triangles ? kFragment : role == Role::sky ? kSkyFragment : kResolveFragment;
  GlObject program =
      link(compile(GL_VERTEX_SHADER, defines, {vertex}), compile(GL_FRAGMENT_SHADER, defines, {kFragmentCommon, fragment}));
  return programs_.emplace(key, std::move(program)).first->second.name();
}

}  // namespace flockstep::render
