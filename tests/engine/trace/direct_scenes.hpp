// Primitives and rays for tests of direct tracing.
#pragma once

#include <hwy/targets.h>

#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "on_target.hpp"
#include "prepared/prepared_world.hpp"
#include "ray_oracle.hpp"
#include "tasks/terms.hpp"
#include "trace/calibrated.hpp"
#include "trace/direct.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"
#include "trace/user_geometry.hpp"

namespace flockstep::trace::direct {

using oracle::Vec3d;
using namespace testing;

// Makes primitives of all kinds in turn, half of them axis-aligned, with sizes over two decades.
inline std::vector<Primitive> random_primitives(Random& random, int count, bool with_room) {
  using enum PrimitiveKind;
  std::vector<Primitive> primitives;
  if (with_room) primitives.push_back(primitive(room, random.point(0.5F), {7.0F, 6.5F, 4.0F}));
  for (int i = 0; i < count; ++i) {
    const auto size = [&] { return random.within(0.0F, 1.0F) < 0.2F ? random.within(0.02F, 0.1F) : random.within(0.1F, 1.5F); };
    const PrimitiveKind kind = std::array{box, cylinder, capsule, sphere, plane, disc}[static_cast<std::size_t>(i) % 6];
    Vec3 half(size(), size(), size());
    if (kind != box && kind != plane) half.y() = half.x();
    if (kind == sphere) half.z() = half.x();
    if (kind == capsule) half.z() += half.x();
    if (kind == plane || kind == disc) half.z() = 0.0F;
    const bool aligned = kind == sphere || random.within(0.0F, 1.0F) < 0.5F;
    primitives.push_back(primitive(kind, random.point(5.0F), half, aligned ? Quat::Identity() : random.rotation()));
  }
  return primitives;
}

// A bundle and a block, and the data that the tracing paths need.
struct Probe {
  RayBundle bundle;
  CandidateSet candidates;
  Tracer tracer;

  // Gathers candidates and traces directly. Returns false if too much is in view.
  bool directly(const Scene& scene) {
    const FlushDenormals flush;
    scene.gather(bundle.origin, 0.0F, bundle.range, false, candidates);
    return !candidates.crowded && trace_direct(std::span(candidates.list).first(candidates.count), kMaxDirect, bundle);
  }
  const RayBlock& block() { return tracer.block(); }
  // Traces the same rays as a block.
  void as_block(const Scene& scene) {
    testing::copy(bundle, tracer.block());
    const FlushDenormals flush;
    tracer.trace_block(scene);
  }
};

}  // namespace flockstep::trace::direct
