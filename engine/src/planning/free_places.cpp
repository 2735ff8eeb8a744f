#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>
#include <vector>

#include "base/in_world.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "flockstep/planning.hpp"
#include "flockstep/raycast.hpp"
#include "planning/draws.hpp"
#include "planning/reach.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

constexpr std::uint32_t kDrawsAtOnce = 64;
constexpr std::uint32_t kMaxDraws = 100'000;  // draws in a row without a place
constexpr std::size_t kMaxFarPlaces = 1000;   // unreachable places in a row

Aabb drawn_box(const World& world, const FreePlacesConfig& config) {
  if (config.box) return *config.box;
  Aabb box = world.bounds();
  const bool has_room = !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
  if (!has_room) box.max.z() = std::min(box.max.z() + config.max_height_m, static_cast<float>(kMaxCoordinate));
  return box;
}

void check(const FreePlacesConfig& config) {
  if (config.clearance_m) require_not_negative(*config.clearance_m, "clearance_m");
  require_positive(config.max_height_m, "max_height_m");
  require_positive(config.cell_m, "cell_m");
  if (!config.box) return;
  require(is_in_world(config.box->min) && is_in_world(config.box->max), "box", in_world("finite coordinates"),
          "a coordinate that is not");
  require((config.box->min.array() <= config.box->max.array()).all(), "box", "min <= max along each axis", "min > max");
}

// Finds free places of a world one by one.
class Places {
 public:
  Places(const World& world, const DroneModel& drone, const FreePlacesConfig& config)
      : world_(world),
        hull_(drone),
        obstacles_(prepared(world).obstacles()),
        config_(config),
        clearance_(config.clearance_m.value_or(drone.radius())),
        box_(drawn_box(world, config)) {}

  const Aabb& box() const { return box_; }

  Vec3 next() {
    refused_ = {};
    for (std::uint32_t drawn = 0; taken_ == found_.size(); drawn += kDrawsAtOnce) {
      if (drawn >= kMaxDraws) refuse_all(drawn);
      Interrupt::poll();
      found_.clear();
      taken_ = 0;
      draw();
    }
    return found_[taken_++];
  }

 private:
  enum Reason : std::uint8_t { nothing_below, behind, no_room };
  struct Candidate {
    Vec3 place;
    float again;  // uniform in [0, 1): new height if the place is too high
  };

  void draw() {
    std::vector<Candidate> candidates(kDrawsAtOnce);
    for (Candidate& candidate : candidates) {
      Draws draws(Draws::kPlaces, config_.seed, drawn_++);
      for (int axis = 0; axis < 3; ++axis) {
        const double share = draws.uniform(0.0, 1.0);
        const double low = box_.min[axis];
        candidate.place[axis] = static_cast<float>(low + share * (static_cast<double>(box_.max[axis]) - low));
      }
      candidate.again = static_cast<float>(draws.uniform(0.0, 1.0));
    }
    look(candidates, -1.0F, [this](Candidate& candidate, float range) {
      if (!std::isfinite(range)) {
        ++refused_[nothing_below];
        return false;
      }
      if (range > config_.max_height_m) candidate.place.z() -= range - candidate.again * config_.max_height_m;
      return candidate.place.z() >= box_.min.z();
    });
    look(candidates, 1.0F, [](Candidate&, float) { return true; });
    for (const Candidate& candidate : candidates) {
      const bool fits = obstacles_.distance(candidate.place, clearance_) >= clearance_ &&
                        !collision::overlaps(obstacles_, hull_, Pose{.position = candidate.place});
      if (fits) {
        found_.push_back(candidate.place);
      } else {
        ++refused_[no_room];
      }
    }
  }

  // Keeps a candidate if a ray straight down (up = -1) or up (up = 1) hits no back face of a triangle, and keep(candidate,
  // range) returns true.
  template <class Keep>
  void look(std::vector<Candidate>& candidates, float up, const Keep& keep) {
    std::vector<float> origins;
    std::vector<float> directions;
    for (const Candidate& candidate : candidates) {
      origins.insert(origins.end(), candidate.place.data(), candidate.place.data() + 3);
      directions.insert(directions.end(), {0.0F, 0.0F, up});
    }
    const RayHits hits = raycast(world_, origins, directions, 4.0F * static_cast<float>(kMaxCoordinate));
    std::vector<Candidate> kept;
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      if (shows_its_back(hits.primitive[i], up)) {
        ++refused_[behind];
      } else if (keep(candidates[i], hits.t_hit[i])) {
        kept.push_back(candidates[i]);
      }
    }
    candidates = std::move(kept);
  }

  bool shows_its_back(std::int32_t element, float up) const {
    const auto first_triangle = static_cast<std::int32_t>(world_.primitives().size());
    if (element < first_triangle) return false;
    const TriangleMesh& mesh = world_.triangles();
    const auto& [a, b, c] = mesh.triangles[static_cast<std::size_t>(element - first_triangle)];
    const auto at = [&mesh](std::int32_t i) { return mesh.vertices[static_cast<std::size_t>(i)].cast<double>(); };
    const Eigen::Vector3d origin = at(a);
    const Eigen::Vector3d normal = (at(b) - origin).cross(at(c) - origin);
    return normal.z() * static_cast<double>(up) > 0.0;
  }

  [[noreturn]] void refuse_all(std::uint32_t drawn) const {
    std::ostringstream expected;
    expected << "a box with free places: above something, not behind a surface, and " << clearance_
             << " m from everything (clearance_m)";
    std::ostringstream got;
    got << "none in " << drawn << " draws from (" << box_.min.transpose() << ") to (" << box_.max.transpose()
        << "): " << refused_[nothing_below] << " with nothing below, " << refused_[behind] << " behind a surface, "
        << refused_[no_room] << " too close to something";
    refuse("box", expected.str(), got.str());
  }

  const World& world_;
  collision::Hull hull_;
  const collision::Obstacles& obstacles_;
  FreePlacesConfig config_;
  float clearance_;
  Aabb box_;
  std::uint32_t drawn_ = 0;
  std::array<std::size_t, 3> refused_{};  // since the last place, by Reason
  std::vector<Vec3> found_;
  std::size_t taken_ = 0;  // number of places taken from found_
};

void require_place(const World& world, const DroneModel& drone, const Vec3& place) {
  require(is_in_world(place), "reachable_from", in_world("finite coordinates"), "a coordinate that is not");
  require(is_free(world, drone, Pose{.position = place}), "reachable_from", "room for the drone",
          "a place where it touches an obstacle");
}

}  // namespace

bool is_free(const World& world, const DroneModel& drone, const Pose& pose) {
  return !collision::overlaps(prepared(world).obstacles(), collision::Hull(drone), pose);
}

std::vector<Vec3> free_places(const World& world, const DroneModel& drone, std::size_t count, const FreePlacesConfig& config) {
  check(config);
  if (config.reachable_from) require_place(world, drone, *config.reachable_from);
  Places places(world, drone, config);
  std::optional<Reach> reach;
  if (config.reachable_from) reach.emplace(world, drone, *config.reachable_from, places.box(), config.cell_m);
  std::vector<Vec3> found;
  for (std::size_t far = 0; found.size() < count;) {
    const Vec3 place = places.next();
    if (reach && !reach->includes(place)) {
      ++far;
      require(far < kMaxFarPlaces, "reachable_from", "a place from which the drone can reach others",
              std::to_string(far) + " unreachable places in a row");
      continue;
    }
    far = 0;
    found.push_back(place);
  }
  return found;
}

Markers drawn_markers(const World& world, const DroneModel& drone, const FreePlacesConfig& config,
                      std::optional<float> distance_m, bool waypoints) {
  constexpr int kStarts = 20;  // some may lie in small closed spaces
  constexpr int kGoals = 50;   // per start
  check(config);
  if (distance_m) require_not_negative(*distance_m, "distance_m");
  if (config.reachable_from) require_place(world, drone, *config.reachable_from);
  Places places(world, drone, config);
  const Aabb& box = places.box();
  const float least = distance_m.value_or((box.max - box.min).head<2>().norm() / 3.0F);
  Markers markers{.radius = world.markers().radius};
  for (int i = 0; i < kStarts; ++i) {
    const Vec3 start = config.reachable_from ? *config.reachable_from : places.next();
    Reach reach(world, drone, start, places.box(), config.cell_m);
    for (int j = 0; j < kGoals; ++j) {
      const Vec3 goal = places.next();
      if ((goal - start).norm() < least || !reach.includes(goal)) continue;
      markers.start = start;
      markers.goal = goal;
      if (waypoints) {
        const auto path = plan(world, drone, start, {&goal, 1});
        if (!path) continue;  // connected only by a gap that is too narrow for the grid of plan()
        markers.waypoints.assign(path->begin() + 1, path->end() - 1);
      }
      return markers;
    }
  }
  std::ostringstream got;
  got << least << " m: none of " << kStarts * kGoals << " pairs of places is that far apart and connected";
  refuse("distance_m", "a distance between places that the drone can fly between", got.str());
}

}  // namespace flockstep
