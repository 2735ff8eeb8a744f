// Rules for every scene, independent of its source.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "flockstep/limits.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Smaller sizes are rejected. Their squares are still far from underflow.
inline constexpr double kMinSize = 1e-6;  // m
// Limit for corners of rooms, which may differ from the values in the file by half a float32 step.
inline constexpr double kMaxCorner = kMaxCoordinate + 0.125;  // m
// Tolerance for the norm of a quaternion. Larger deviations from 1 are mistakes, not rounding.
inline constexpr double kQuaternionTolerance = 1e-3;

// Twice the area over the squared longest side. A triangle below this ratio has no usable normal in float32.
inline constexpr double kDegenerateRatio = 1e-7;

// The semantic id of the last material, its index plus 1, stays below those of the markers.
inline constexpr std::size_t kMaxMaterials = kSemanticStart - 1;
// Objects and textures have 16-bit indices.
inline constexpr std::size_t kMaxObjects = 65536;
inline constexpr std::size_t kMaxTextures = 65536;
inline constexpr int kMaxTexturePx = 16384;
inline constexpr std::size_t kMaxGates = 4096;

// Worlds with at least this many triangles return freed memory to the system; for them, memory matters more than a few
// milliseconds.
inline constexpr std::size_t kManyTriangles = std::size_t{1} << 18U;

// Allowed tints; see Lighting::tint.
inline constexpr Limits kTints = between(0.0, 10.0);

// Returns true if the corners coincide, are collinear, or are so close to that that the normal is rounding noise.
bool is_degenerate(const Vec3& a, const Vec3& b, const Vec3& c);

// Describes triangles that a reader dropped: "2 triangles without an area".
std::string words_of_flat(std::size_t count);

// Returns (w, x, y, z) as a unit quaternion in float32. A quaternion that is already unit in float32 keeps its bits, so that
// writing and reading it again changes nothing. The norm must be within kQuaternionTolerance of 1.
Quat unit_quaternion(const Eigen::Vector4d& wxyz);

// Returns a direction, which must not be 0, as a unit vector in float32. A vector that is already unit in float32 keeps its
// bits.
Vec3 unit_direction(const Eigen::Vector3d& direction);

// Throws std::invalid_argument that names the marker, the expected value and the actual one.
void check_markers(const Markers& markers);

// Normalizes the rotations. Throws std::invalid_argument that names the body and the field: "bodies[3].motion.period_s".
void check_bodies(std::vector<BodyConfig>& bodies);

// Normalizes the direction to the sun. Throws std::invalid_argument like check_markers().
void check_light(Light& light);

// Multiplies base colours by tints; see Lighting. Throws std::invalid_argument like check_markers().
void apply_tint(std::span<const std::array<float, 3>> tint, std::vector<Material>& materials);

// Converts a description to the canonical form that the engine relies on:
// - primitives are sorted by kind (stable), and rooms match their corners;
// - quaternions and the sun's direction are unit;
// - each triangle has a material index and an object number;
// - triangles are grouped by object, in the order of the objects; no vertex is unused or shared between objects;
// - there are uv if a material has a texture;
// - there is memory for one more vertex, because Embree uses the vertices in place and reads four numbers of the last one.
// A canonical description is returned unchanged. Throws std::invalid_argument that names the field, the expected value and the
// actual one.
SceneDescription canonical(SceneDescription description);

// Returns the solid parts of a world, all with material 0 and visible, without markers and light.
SceneDescription solids_of(const World& world);

// Appends vertex colours for the `count` vertices that were added last. If `colors` is empty but the mesh has colours, they are
// white.
void append_colors(std::span<const std::array<float, 3>> colors, std::size_t count, TriangleMesh& mesh);

// Returns the smallest axis-aligned box around a primitive.
Aabb bounds(const Primitive& primitive);

// Hash that identifies worlds with the same content. Hashes every byte of every field except the scene's name, which affects
// neither simulation nor rendering. Material names count, because programs look materials up by name. Expects the canonical form,
// in which equivalent descriptions are equal.
std::uint64_t content_hash(const SceneDescription& description);

}  // namespace flockstep
