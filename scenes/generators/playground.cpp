// Generates playgrounds. Only basic IEEE operations are used and every coordinate is rounded to 1 cm, so that a seed gives the
// same world on every machine.
#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/planning.hpp"
#include "generators/layouts.hpp"
#include "generators/movers.hpp"
#include "planning/draws.hpp"
#include "planning/navigable.hpp"

namespace flockstep {
namespace {

// Lengths in m for a drone of 0.93 x 0.59 m. They do not scale with the room.
constexpr double kMarkerClearance = 0.9;    // from a pillar's surface to a marker
constexpr double kPillarGap = 1.4;          // between pillar surfaces, if there is room
constexpr double kSpawnReach = 0.25;        // half size of the spawn box; kMarkerClearance makes the drone fit anywhere in it
constexpr double kVerticalClearance = 0.5;  // from a marker to floor and ceiling
constexpr double kLaneHalfWidth = 0.6;      // more than half the drone's diagonal
constexpr double kLaneDetour = 1.6;         // sideways detour of the lane around the pillar on its leg
constexpr int kMaxWaypoints = 4;

// Size of the bundled playgrounds' room in m, and the marker positions in it. Rooms of other sizes scale these.
constexpr double kRoom[3] = {14.0, 14.0, 5.25};
constexpr double kStartX = 2.3;
constexpr double kGoalX = 11.7;
constexpr double kXSpread = 0.4;  // random offset of every marker, to both sides
constexpr double kYRange[2] = {2.7, 11.3};
constexpr double kYStep = 3.2;  // maximum change of y between markers
constexpr double kZRange[2] = {1.0, 4.0};

// Start, waypoints and goal, by increasing x.
struct Route {
  std::vector<Vec3d> markers;

  std::size_t num_legs() const { return markers.size() - 1; }
  Vec2d flat(std::size_t i) const { return markers[i].head<2>(); }
};

double distance_to_segment(const Vec2d& point, const Vec2d& a, const Vec2d& b) {
  const Vec2d along = b - a;
  const double t = std::clamp((point - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (point - a - t * along).norm();
}

// Returns a y to the left or right that makes the leg long enough. It is in range if either side is. x and y are in the scale
// of the bundled room.
double next_y(Draws& draws, const Vec3d& last, double x, const Vec3d& scale, double shortest_leg) {
  const double dx = x * scale.x() - last.x();
  const double least = std::sqrt(std::max(0.0, shortest_leg * shortest_leg - dx * dx)) / scale.y() + 0.02;
  const double step = draws.uniform(std::min(least, kYStep), kYStep);
  const double from = last.y() / scale.y();
  const double sign = draws.below(2) == 0 ? -1.0 : 1.0;
  const auto in_range = [](double y) { return y >= kYRange[0] && y <= kYRange[1]; };
  return in_range(from + sign * step) ? from + sign * step : from - sign * step;
}

std::optional<Route> draw_route(Draws& draws, const PlaygroundConfig& config) {
  const Vec3d scale(config.size_m[0] / kRoom[0], config.size_m[1] / kRoom[1], config.size_m[2] / kRoom[2]);
  // Each leg must have room for a pillar that is clear of the markers at both ends.
  const double shortest_leg = 2.0 * (kMarkerClearance + config.pillar_radius_m) + 0.1;
  // Sideways steps allow more legs than the room's length alone.
  const int most_legs = static_cast<int>(1.4 * (kGoalX - kStartX) * scale.x() / shortest_leg);
  const int num_legs = most_legs < 2 ? 1 : 2 + draws.below(std::min(most_legs, kMaxWaypoints + 1) - 1);

  Route route;
  for (int i = 0; i <= num_legs; ++i) {
    const double spread = kXSpread / std::max(1, num_legs - 1);
    const double x = kStartX + (kGoalX - kStartX) * i / num_legs + draws.uniform(-spread, spread);
    const double y = i == 0 ? draws.uniform(kYRange[0], kYRange[1]) : next_y(draws, route.markers.back(), x, scale, shortest_leg);
    const double z =
        std::clamp(draws.uniform(kZRange[0], kZRange[1]) * scale.z(), kVerticalClearance, config.size_m[2] - kVerticalClearance);
    route.markers.emplace_back(centimetres(x * scale.x()), centimetres(y * scale.y()), centimetres(z));
  }
  for (std::size_t i = 0; i < route.num_legs(); ++i) {
    if ((route.flat(i + 1) - route.flat(i)).norm() < shortest_leg) return std::nullopt;
  }
  return route;
}

class PillarField {
 public:
  PillarField(const PlaygroundConfig& config, const Route& route) : config_(config), route_(route) {}

  // Places one pillar on the straight flight path. About half of the others stand near the route, the rest anywhere. keeps_lane
  // keeps a drone-wide lane free between the markers, for rooms so full that a random layout hardly ever leaves one.
  bool fill(Draws& draws, bool keeps_lane) {
    if (config_.pillars > 0 && !place([&] { return on_a_leg(draws, keeps_lane); })) return false;
    while (static_cast<int>(centers_.size()) < config_.pillars) {
      if (!place([&] { return draws.below(2) == 0 ? beside_the_route(draws) : anywhere(draws); })) return false;
    }
    return true;
  }

  const std::vector<Vec2d>& centers() const { return centers_; }

 private:
  // Draws random positions until one fits. After repeated misses the gap shrinks for all later pillars, so that crowded fields
  // come out even.
  template <class Dart>
  bool place(const Dart& dart) {
    constexpr int kDarts = 100;
    constexpr double kShrink = 0.9;
    constexpr double kMinGap = 0.02;
    for (; gap_ > kMinGap; gap_ *= kShrink) {
      for (int i = 0; i < kDarts; ++i) {
        const Vec2d center = dart();
        if (!fits(center)) continue;
        centers_.push_back(center);
        return true;
      }
    }
    return false;
  }

  bool fits(const Vec2d& center) const {
    const double radius = config_.pillar_radius_m;
    const Vec2d size(config_.size_m[0], config_.size_m[1]);
    if (!(center.minCoeff() >= radius && (size - center).minCoeff() >= radius)) return false;
    for (std::size_t i = 0; i < route_.markers.size(); ++i) {
      if ((center - route_.flat(i)).norm() < kMarkerClearance + radius) return false;
    }
    for (std::size_t i = 0; i + 1 < lane_.size(); ++i) {
      if (distance_to_segment(center, lane_[i], lane_[i + 1]) < kLaneHalfWidth + radius) return false;
    }
    return std::all_of(centers_.begin(), centers_.end(),
                       [&](const Vec2d& other) { return (center - other).norm() >= gap_ + 2.0 * radius; });
  }

  Vec2d on_a_leg(Draws& draws, bool keeps_lane) {
    const auto leg = static_cast<std::size_t>(draws.below(static_cast<int>(route_.num_legs())));
    const Vec2d along = route_.flat(leg + 1) - route_.flat(leg);
    const Vec2d point = route_.flat(leg) + draws.uniform(0.2, 0.8) * along;
    if (keeps_lane) lay_lane(leg, point + (draws.below(2) == 0 ? 1.0 : -1.0) * kLaneDetour * across(along));
    const Vec2d aside = Vec2d::Constant(0.15);
    return rounded(point + draws.point(-aside, aside));
  }

  // Makes the lane follow the route, with a detour through a point beside one of its legs.
  void lay_lane(std::size_t leg, const Vec2d& detour) {
    lane_.clear();
    for (std::size_t i = 0; i < route_.markers.size(); ++i) {
      lane_.push_back(route_.flat(i));
      if (i != leg) continue;
      const Vec2d size(config_.size_m[0], config_.size_m[1]);
      const Vec2d margin = Vec2d::Constant(kLaneHalfWidth);
      lane_.push_back(detour.cwiseMax(margin).cwiseMin(size - margin));
    }
  }

  static Vec2d across(const Vec2d& v) { return Vec2d(-v.y(), v.x()) / v.norm(); }

  Vec2d beside_the_route(Draws& draws) const {
    const Vec2d reach = Vec2d::Constant(2.0 * config_.size_m[1] / kRoom[1]);
    const auto leg = static_cast<std::size_t>(draws.below(static_cast<int>(route_.num_legs())));
    const Vec2d point = route_.flat(leg) + draws.uniform(0.0, 1.0) * (route_.flat(leg + 1) - route_.flat(leg));
    return rounded(point + draws.point(-reach, reach));
  }

  Vec2d anywhere(Draws& draws) const { return rounded(draws.point(Vec2d::Zero(), {config_.size_m[0], config_.size_m[1]})); }

  static Vec2d rounded(const Vec2d& point) { return {centimetres(point.x()), centimetres(point.y())}; }

  const PlaygroundConfig& config_;
  const Route& route_;
  double gap_ = kPillarGap;
  std::vector<Vec2d> lane_;  // empty if no lane is kept free
  std::vector<Vec2d> centers_;
};

SceneDescription describe(const PlaygroundConfig& config, const Route& route, const std::vector<Vec2d>& pillars) {
  SceneDescription scene;
  scene.name = "playground/seed-" + std::to_string(config.seed);
  scene.materials = {Material{"white", {0.9F, 0.9F, 0.9F}}, Material{"pillar", {0.35F, 0.45F, 0.6F}}};
  const Vec3 half = Vec3(config.size_m[0], config.size_m[1], config.size_m[2]) / 2.0F;
  scene.primitives.push_back(Primitive{.kind = PrimitiveKind::room, .center = half, .half_extents = half, .material = 0});
  for (const Vec2d& center : pillars) {
    scene.primitives.push_back(Primitive{.kind = PrimitiveKind::cylinder,
                                         .center = Vec3(static_cast<float>(center.x()), static_cast<float>(center.y()), half.z()),
                                         .half_extents = Vec3(config.pillar_radius_m, config.pillar_radius_m, half.z()),
                                         .material = 1});
  }
  Markers& markers = scene.markers;
  markers.start = route.markers.front().cast<float>();
  markers.goal = route.markers.back().cast<float>();
  for (std::size_t i = 1; i + 1 < route.markers.size(); ++i) markers.waypoints.push_back(route.markers[i].cast<float>());
  const Vec3d reach = Vec3d::Constant(kSpawnReach);
  markers.spawn_box = Aabb{(route.markers.front() - reach).cast<float>(), (route.markers.front() + reach).cast<float>()};
  return scene;
}

// Adds pillars, nearly as high as the room, and lower boxes that hang in the middle.
std::shared_ptr<const World> with_movers(const std::shared_ptr<const World>& world, const PlaygroundConfig& config,
                                         std::uint32_t attempt) {
  if (config.movers == 0) return world;
  const float high = config.size_m[2];
  BodyConfig pillar;
  pillar.name = "pillar";
  pillar.shape = BodyShape::cylinder;
  pillar.size_m = {2.0F * config.pillar_radius_m, 2.0F * config.pillar_radius_m, high - 0.2F};
  pillar.position_m[2] = 0.5F * high;
  BodyConfig box;
  box.name = "box";
  box.size_m = {0.6F, 0.6F, 0.6F * high};
  box.position_m[2] = 0.5F * high;
  Movers movers(*world, Draws::kPlayground, config.seed, attempt);
  const Aabb area{Vec3::Zero(), Vec3(config.size_m[0], config.size_m[1], high)};
  movers.add_on_lines({pillar, box}, config.movers,
                      {.area = area, .least_m = 1.5, .most_m = 5.0, .least_mps = 0.4, .most_mps = 1.2, .slides = true});
  return world->with_bodies(movers.bodies());
}

}  // namespace

void PlaygroundConfig::validate() const {
  check_fields(*this, "playground: ");
  const float thickest = std::min(size_m[0], size_m[1]) / 14.0F;
  if (pillar_radius_m <= thickest) return;
  std::ostringstream range;
  range << "at most " << thickest << " (a fourteenth of the room)";
  refuse("playground: pillar_radius_m", range.str(), pillar_radius_m);
}

std::shared_ptr<const World> playground(const PlaygroundConfig& config) {
  constexpr std::uint32_t kAttempts = 256;
  constexpr std::uint32_t kFreeAttempts = 4;  // attempts before a lane is kept free
  constexpr float kCoarseCell = 0.2F;         // m, fine enough for almost every layout, and four times faster
  config.validate();
  const DroneModel drone = DroneModel::quadrotor650();
  const auto lay_out = [&](std::uint32_t attempt) -> std::shared_ptr<const World> {
    Draws draws(Draws::kPlayground, config.seed, attempt);
    const std::optional<Route> route = draw_route(draws, config);
    if (!route) return nullptr;
    PillarField field(config, *route);
    if (!field.fill(draws, attempt >= kFreeAttempts)) return nullptr;

    auto world = std::make_shared<const World>(describe(config, *route, field.centers()));
    const Vec3 start = *world->markers().start;
    std::vector<Vec3> goals = world->markers().waypoints;
    goals.push_back(*world->markers().goal);
    std::vector<Vec3> straight{start};
    straight.insert(straight.end(), goals.begin(), goals.end());
    if (config.pillars > 0 && is_free_way(*world, collision::Hull(drone), straight)) return nullptr;
    const bool has_path = plan(*world, drone, start, goals, kCoarseCell) || plan(*world, drone, start, goals);
    return has_path ? with_movers(world, config, attempt) : nullptr;
  };
  if (auto world = first_layout(kAttempts, lay_out)) return world;
  std::ostringstream expected;
  std::ostringstream got;
  expected << "few enough for a free path through " << config.size_m[0] << " x " << config.size_m[1] << " m";
  got << config.pillars << " of radius " << config.pillar_radius_m << " m (no path in " << kAttempts << " layouts)";
  refuse("playground: pillars", expected.str(), got.str());
}

}  // namespace flockstep
