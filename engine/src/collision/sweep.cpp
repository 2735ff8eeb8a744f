#include "collision/sweep.hpp"

#include <algorithm>

#include "collision/path.hpp"
#include "collision/search.hpp"

namespace flockstep::collision {

Pose interpolate(const Pose& from, const Pose& to, float fraction) {
  if (fraction <= 0.0F) return from;
  if (fraction >= 1.0F) return to;
  const Path path(from, to);
  const double time = static_cast<double>(fraction);
  return {path.position(time).cast<float>(), path.rotation(time).normalized().cast<float>()};
}

Contact sweep(const Obstacles& obstacles, const Hull& hull, const Pose& from, const Pose& to) {
  Search search(hull, from, to);
  for (const RoomInterior& room : obstacles.rooms()) search.test(room);
  obstacles.for_each_near(search.middle(), search.reach(),
                          [&](std::uint32_t element) { search.test(obstacles.convex(element), element); });
  return search.contact();
}

bool is_clear(const Obstacles& obstacles, std::span<const std::uint32_t> elements, const Hull& hull, const Pose& from,
              const Pose& to) {
  Search search(hull, from, to);
  for (const RoomInterior& room : obstacles.rooms()) search.test(room);
  return !search.has_contact() && std::none_of(elements.begin(), elements.end(), [&](std::uint32_t element) {
    return search.is_touched(obstacles.convex(element));
  });
}

bool overlaps(const Obstacles& obstacles, const Hull& hull, const Pose& pose) {
  return sweep(obstacles, hull, pose, pose).inside;
}

}  // namespace flockstep::collision
