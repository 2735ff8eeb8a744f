// trace::Scene: one world's acceleration structure (Embree), and the question asked of it: what is the nearest thing along
// these rays.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "swiftlet/world.hpp"
#include "trace/embree.hpp"
#include "trace/packets.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace swiftlet::trace {

// Called for every element (index into World::primitives(), then primitives().size() + triangle index) near a point.
using NearbyCallback = void (*)(void* context, std::uint32_t element);

// Denormals as zero on this thread for as long as this lives: Embree asks for it.
class FlushDenormals {
 public:
  FlushDenormals();
  ~FlushDenormals();
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  unsigned int saved_;
};

class Scene {
 public:
  explicit Scene(const World& world);  // keeps no reference to the world
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  // Nearest hits of a block of rays: fills t_hit and element. A ray's result has the same bits in any block, beside any
  // other rays. Call under FlushDenormals.
  void intersect(RayBlock& rays) const;

  // The same for rays that all start at the origin and have the same range. True if so little is within reach that it was
  // answered directly; false if nothing was done and the rays are to go through intersect(), best together with others'.
  bool intersect_nearby(const Vec3& origin, float range_m, RayBlock& rays) const;

  // The broad phase of collision: calls back for each element whose bounding box comes within radius (m) of center; may call
  // back for some that do not. Allocates nothing; safe from many threads.
  void for_each_nearby(const Vec3& center, float radius, NearbyCallback callback, void* context) const;

 private:
  struct Release {
    void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  };

  void add_primitives(std::span<const Primitive> primitives);
  void add_triangles(const TriangleMesh& mesh);

  std::shared_ptr<RTCDeviceTy> device_;
  std::unique_ptr<RTCSceneTy, Release> scene_;
  std::vector<Shape> shapes_;
  std::vector<NumberedShape> rooms_;
  std::vector<NumberedShape> numbered_;  // every primitive, if they are all there is and not many; else empty
};

}  // namespace swiftlet::trace
