// The rules every scene obeys, wherever it came from.
#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "flockstep/limits.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Sizes below this are refused: their squares are still far from underflow.
inline constexpr double kMinSize = 1e-6;  // m
// Corners of rooms, which may be half a float32 step from where they were read.
inline constexpr double kMaxCorner = kMaxCoordinate + 0.125;  // m
// How far the norm of a quaternion may be from 1 before it is taken for a mistake rather than for rounding.
inline constexpr double kQuaternionTolerance = 1e-3;

// Two times the area over the longest side squared, below which a triangle has no usable normal in float32.
inline constexpr double kDegenerateRatio = 1e-7;

// So many that the semantic id of the last, its index plus 1, stays below those of the markers.
inline constexpr std::size_t kMaxMaterials = kSemanticStart - 1;
// Their numbers are 16 bits wide.
inline constexpr std::size_t kMaxObjects = 65536;
inline constexpr std::size_t kMaxTextures = 65536;
inline constexpr int kMaxTexturePx = 16384;

// From so many triangles of a world on, what each takes in memory counts for more than a few milliseconds here and there.
inline constexpr std::size_t kManyTriangles = std::size_t{1} << 18U;

// See Lighting::tint.
inline constexpr Limits kTints = between(0.0, 10.0);

// True if the corners are the same point, on a line, or so nearly that the normal is rounding noise.
bool is_degenerate(const Vec3& a, const Vec3& b, const Vec3& c);

// "2 triangles without an area", which a reader has left out.
std::string words_of_flat(std::size_t count);

// (w, x, y, z) as a unit quaternion in float32; a quaternion that is already unit in float32 keeps its bits, so that writing and
// reading it again changes nothing. The norm must be within kQuaternionTolerance of 1.
Quat unit_quaternion(const Eigen::Vector4d& wxyz);

// A direction, which must not be 0, as a unit vector in float32; one that is already unit in float32 keeps its bits.
Vec3 unit_direction(const Eigen::Vector3d& direction);

// Throws std::invalid_argument naming the marker, what was expected and what came.
void check_markers(const Markers& markers);

// Throws likewise; the direction to the sun becomes unit.
void check_light(Light& light);

// Multiplies base colours; see Lighting. Throws likewise.
void apply_tint(std::span<const std::array<float, 3>> tint, std::vector<Material>& materials);

// Brings a description into the one form the engine relies on: primitives ordered by kind (stable), rooms as their corners give
// them, quaternions and the sun's direction unit, one material index and one object number per triangle, and the triangles of
// each object together, in the order of the objects, with vertices that are theirs alone and all used; uv where a material has a
// texture; and memory for one vertex more, because Embree, which is given the vertices where they are, reads four numbers of the
// last one. Descriptions in that form come out as they are. Throws std::invalid_argument naming the field, what was expected and
// what came.
SceneDescription canonical(SceneDescription description);

// What of a world is solid, of one material, and that visual, too; without markers and light.
SceneDescription solids_of(const World& world);

// Goes on with the colours of a mesh's vertices, or begins with them: `count` vertices were added last, and have these or none.
void append_colors(std::span<const std::array<float, 3>> colors, std::size_t count, TriangleMesh& mesh);

// The smallest axis-aligned box around a primitive.
Aabb bounds(const Primitive& primitive);

}  // namespace flockstep
