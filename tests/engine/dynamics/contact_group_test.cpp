// Drones that touch each other during a tick: closed forms of bounces, conservation laws, and independence of their order.
#include <initializer_list>

#include "batch_helpers.hpp"
#include "convex_oracle.hpp"
#include "dynamics/contact.hpp"
#include "dynamics/lane_group.hpp"
#include "flight_state.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

using dynamics::ContactResolver;
using dynamics::GroupMember;
using namespace testing;
using Vec3d = Eigen::Vector3d;

constexpr float kTickS = 0.002F;  // s
const Vec3 kHalf(0.3F, 0.2F, 0.1F);

const DroneModel& box_drone() {
  static const DroneModel model([] {
    std::vector<Vec3> corners;
    for (int i = 0; i < 8; ++i) {
      corners.emplace_back((i & 1) != 0 ? kHalf.x() : -kHalf.x(), (i & 2) != 0 ? kHalf.y() : -kHalf.y(),
                           (i & 4) != 0 ? kHalf.z() : -kHalf.z());
    }
    return corners;
  }());
  return model;
}

// A crystal-like drone: a ball of radius 1 m would rebound centrally; an octahedron that points at the other one does, too.
const DroneModel& pointed_drone() {
  static const DroneModel model(
      {Vec3(0.3F, 0, 0), Vec3(-0.3F, 0, 0), Vec3(0, 0.3F, 0), Vec3(0, -0.3F, 0), Vec3(0, 0, 0.3F), Vec3(0, 0, -0.3F)});
  return model;
}

Airframe frame_of(double mass) {
  Airframe frame{.mass_kg = mass, .inertia_kgm2 = {0.01 * mass, 0.014 * mass, 0.02 * mass}};
  return frame;
}

DynamicsConfig contact_config(OnContact on_contact, float restitution = 0.5F, float friction = 0.0F) {
  return {.motion = Motion::rotors, .on_contact = on_contact, .restitution = restitution, .friction = friction};
}

const collision::Obstacles& nothing() {
  static const auto world = make_world({primitive(PrimitiveKind::sphere, {5000, 0, 0}, Vec3::Ones())});
  return prepared(*world).obstacles();
}

// A drone that flies uniformly through a tick.
GroupMember flying(std::uint32_t number, const Pose& from, const Velocity& velocity, const Airframe* frame) {
  GroupMember drone;
  drone.number = number;
  drone.airframe = frame;
  Quat rotation = from.rotation;
  if (const Vec3 turn = kTickS * velocity.angular; turn.norm() > 0.0F) {
    rotation = (from.rotation * Quat(Eigen::AngleAxisf(turn.norm(), turn.normalized()))).normalized();
  }
  drone.motion = {from, {from.position + kTickS * velocity.linear, rotation}, velocity, velocity, static_cast<double>(kTickS)};
  return drone;
}

// The resolver of drones of one model.
struct GroupResolver {
  explicit GroupResolver(const DroneModel& model) : hull(model), corners(model.hull()) {}
  void resolve(std::vector<GroupMember>& drones, const DynamicsConfig& config, const collision::Obstacles& among = nothing()) {
    std::vector<GroupMember*> pointers;
    for (GroupMember& drone : drones) pointers.push_back(&drone);
    inner.resolve(pointers, among, {}, config);
  }

  collision::Hull hull;
  collision::Corners corners;
  ContactResolver inner{hull, corners};
};

struct Totals {
  Vec3d momentum = Vec3d::Zero(), angular = Vec3d::Zero();
  double energy = 0.0;
};

// linear: velocity and place of the centres; places: those at the contact.
Totals totals_of(const std::vector<GroupMember>& drones, const std::array<Pose, 2>& places, bool after) {
  Totals totals;
  for (std::size_t i = 0; i < 2; ++i) {
    const GroupMember& drone = drones[i];
    const Velocity& velocity = after ? drone.velocity : drone.motion.end;
    const Vec3d v = velocity.linear.cast<double>(), w = velocity.angular.cast<double>();
    const Vec3d inertia(drone.airframe->inertia_kgm2[0], drone.airframe->inertia_kgm2[1], drone.airframe->inertia_kgm2[2]);
    const Vec3d spin = inertia.cwiseProduct(w);
    const Vec3d p = drone.airframe->mass_kg * v;
    totals.momentum += p;
    totals.angular += places[i].position.cast<double>().cross(p) + places[i].rotation.cast<double>() * spin;
    totals.energy += 0.5 * (v.dot(p) + w.dot(spin));
  }
  return totals;
}

TEST(ContactGroup, ACentralBounceFollowsTheClosedForm) {
  for (const float restitution : {0.0F, 0.3F, 1.0F}) {
    for (const double mass : {0.5, 1.0, 4.0}) {
      const Airframe light = frame_of(1.0), other = frame_of(mass);
      const float gap = 0.004F, v1 = 3.0F, v2 = -1.0F;
      std::vector<GroupMember> drones{
          flying(0, {{0, 0, 0}, Quat::Identity()}, {{v1, 0, 0}, Vec3::Zero()}, &light),
          flying(1, {{0.6F + gap, 0, 0}, Quat::Identity()}, {{v2, 0, 0}, Vec3::Zero()}, &other),
      };
      GroupResolver resolver(pointed_drone());
      resolver.resolve(drones, contact_config(OnContact::bounce, restitution));
      const double m1 = 1.0, m2 = mass, e = static_cast<double>(restitution);
      const double after1 = ((m1 - e * m2) * 3.0 + (1 + e) * m2 * -1.0) / (m1 + m2);
      const double after2 = ((m2 - e * m1) * -1.0 + (1 + e) * m1 * 3.0) / (m1 + m2);
      EXPECT_NEAR(drones[0].velocity.linear.x(), after1, 1e-5);
      EXPECT_NEAR(drones[1].velocity.linear.x(), after2, 1e-5);
      for (const GroupMember& drone : drones) {
        EXPECT_TRUE(drone.contact.hit);
        EXPECT_EQ(drone.other, 1 - static_cast<std::int32_t>(drone.number));
        EXPECT_EQ(drone.contact.body, -1);
        EXPECT_LT(drone.velocity.angular.norm(), 1e-4F);
        EXPECT_NEAR(drone.contact.fraction, (gap - 1e-4F) / (v1 - v2) / kTickS, 2e-3);
      }
      EXPECT_LT((drones[0].contact.normal - Vec3(-1, 0, 0)).norm(), 1e-3F);
      EXPECT_EQ(drones[0].contact.normal, -drones[1].contact.normal);
      EXPECT_EQ(drones[0].contact.point, drones[1].contact.point);
      EXPECT_NEAR(drones[0].contact.velocity.x(), v2, 1e-3);
      EXPECT_NEAR(drones[1].contact.velocity.x(), v1, 1e-3);
      // Before and after the contact both fly uniformly.
      const double left = (1.0 - static_cast<double>(drones[0].contact.fraction)) * static_cast<double>(kTickS);
      const double met = 3.0 * (static_cast<double>(kTickS) - left);
      EXPECT_NEAR(drones[0].pose.position.x(), met + after1 * left, 1e-6);
    }
  }
}

// Distance (m) in a direction at which two drones may just touch.
float touching_distance(const DroneModel& model, const std::array<Quat, 2>& turns, const Vec3& towards) {
  float first = 0.0F, second = 0.0F;
  for (const Vec3& point : model.hull()) {
    first = std::max(first, towards.dot(turns[0] * point));
    second = std::max(second, -towards.dot(turns[1] * point));
  }
  return first + second;
}

TEST(ContactGroup, BouncesConserveMomentumAndAddNoEnergy) {
  Random random(1);
  int bounces = 0;
  for (int i = 0; i < 30000; ++i) {
    const Airframe frames[] = {frame_of(std::exp(random.within(-2, 2))), frame_of(std::exp(random.within(-2, 2)))};
    const DroneModel& model = i % 2 == 0 ? box_drone() : pointed_drone();
    const float restitution = i % 3 == 0 ? 0.0F : random.within(0, 1), friction = i % 5 == 0 ? 0.0F : random.within(0, 1.5F);
    const Vec3 at = random.point(i % 7 == 0 ? 500.0F : 2.0F), towards = random.direction().normalized();
    std::array<Quat, 2> turns{random.rotation(), random.rotation()};
    if (i % 4 == 0) turns = {Quat::Identity(), Quat::Identity()};  // faces and edges lie flat
    const float apart = touching_distance(model, turns, towards) + random.within(0.001F, 0.01F);
    const Vec3 aside = random.point(i % 4 == 0 ? 0.0F : 0.02F);
    std::vector<GroupMember> drones;
    for (std::uint32_t k = 0; k < 2; ++k) {
      const float speed = (k == 0 ? 1.0F : -1.0F) * random.within(0.0F, 8.0F);
      drones.push_back(flying(k, {k == 0 ? at : Vec3(at + apart * towards + aside), turns[k]},
                              {speed * towards + random.point(1.0F), random.point(5.0F)}, &frames[k]));
    }
    GroupResolver resolver(model);
    resolver.resolve(drones, contact_config(OnContact::bounce, restitution, friction));
    if (!drones[0].contact.hit) {
      EXPECT_FALSE(drones[1].contact.hit);
      continue;
    }
    if (drones[0].contact.inside) continue;
    ++bounces;
    const float fraction = drones[0].contact.fraction;
    const std::array<Pose, 2> places{collision::interpolate(drones[0].motion.from, drones[0].motion.to, fraction),
                                     collision::interpolate(drones[1].motion.from, drones[1].motion.to, fraction)};
    const Totals before = totals_of(drones, places, false), after = totals_of(drones, places, true);
    const double size = 1.0 + frames[0].mass_kg * 10 + frames[1].mass_kg * 10;
    ASSERT_LT((after.momentum - before.momentum).norm(), 1e-5 * size) << "bounce " << i;
    ASSERT_LE(after.energy, before.energy * (1 + 1e-5) + 1e-6) << "bounce " << i;
    // Gyroscopic torques act on both in the rest of the tick; about the contact the angular momentum else stays.
    const Vec3d arm = static_cast<double>(at.norm() + 1.0F) * Vec3d::Ones();
    ASSERT_LT((after.angular - before.angular).norm(), 2e-3 * size * (1.0 + 1e-3 * arm.norm())) << "bounce " << i;
    const oracle::Support first = oracle::hull_at(model, drones[0].pose);
    const oracle::Support second = oracle::hull_at(model, drones[1].pose);
    ASSERT_GT(oracle::distance(first, second).lower, 0.0) << "bounce " << i;
  }
  EXPECT_GT(bounces, 1000);
}

// However often two drones hit each other in a tick, also if impulses cannot part them.
TEST(ContactGroup, PairsKeepTheirMomentum) {
  Random random(3);
  GroupResolver resolver(box_drone());
  int pairs = 0;
  for (int i = 0; i < 30000; ++i) {
    const Airframe frames[] = {frame_of(static_cast<double>(random.within(0.03F, 1))), frame_of(0.5)};
    const Vec3 towards = random.direction().normalized();
    const std::array<Quat, 2> turns{random.rotation(), i % 4 == 0 ? Quat::Identity() : random.rotation()};
    const float apart = touching_distance(box_drone(), turns, towards) + random.within(0.0003F, 0.003F);
    std::vector<GroupMember> drones;
    for (std::uint32_t k = 0; k < 2; ++k) {
      const Velocity velocity{(k == 0 ? 1.0F : -1.0F) * random.within(0, 8) * towards + random.point(2), random.point(20)};
      drones.push_back(flying(k, {k == 0 ? Vec3(Vec3::Zero()) : Vec3(apart * towards), turns[k]}, velocity, &frames[k]));
    }
    resolver.resolve(drones, contact_config(OnContact::bounce, i % 3 == 0 ? 0.0F : random.within(0, 1), random.within(0, 1)));
    if (!drones[0].contact.hit || drones[0].contact.inside || drones[1].contact.inside) continue;
    ++pairs;
    Vec3d change = Vec3d::Zero();  // kg m/s
    for (const GroupMember& drone : drones) {
      change += drone.airframe->mass_kg * (drone.velocity.linear - drone.motion.begin.linear).cast<double>();
    }
    ASSERT_LT(change.norm(), 1e-5) << "pair " << i;
  }
  EXPECT_GT(pairs, 1000);
}

bool same_outcome(const GroupMember& a, const GroupMember& b) {
  return a.pose.position == b.pose.position && a.pose.rotation.coeffs() == b.pose.rotation.coeffs() &&
         a.velocity.linear == b.velocity.linear && a.velocity.angular == b.velocity.angular && a.contact.hit == b.contact.hit &&
         a.contact.inside == b.contact.inside && a.contact.fraction == b.contact.fraction && a.contact.point == b.contact.point;
}

// A drone that can touch no other one is resolved in a shorter way, with the same bits.
TEST(ContactGroup, ADroneFarFromOthersMovesAsIfAlone) {
  Random random(4);
  const auto world = make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(1, 1, 0.6F)),
                                 primitive(PrimitiveKind::box, {0.8F, 0, 0}, Vec3(0.2F, 0.2F, 1))});
  const collision::Obstacles& obstacles = prepared(*world).obstacles();
  GroupResolver resolver(box_drone());
  const Airframe frame = frame_of(0.5);
  int contacts = 0;
  for (const OnContact on_contact : {OnContact::terminate, OnContact::bounce, OnContact::stop}) {
    for (int i = 0; i < 1000; ++i) {
      std::vector<GroupMember> drones{
          flying(0, {random.point(0.7F), random.rotation()}, {random.point(60), random.point(30)}, &frame),
          flying(1, {Vec3(-50, 0, 0), Quat::Identity()}, {}, &frame)};
      drones[1].is_open = true;
      GroupMember alone = drones[0];
      resolver.resolve(drones, contact_config(on_contact), obstacles);
      resolver.inner.resolve(alone, obstacles, {}, contact_config(on_contact));
      contacts += alone.contact.hit;
      ASSERT_EQ(alone.is_deflected, drones[0].is_deflected);
      ASSERT_TRUE(same_outcome(alone, drones[0]));
    }
  }
  EXPECT_GT(contacts, 500);
}

TEST(ContactGroup, ADroneThatHoldsIsAWall) {
  const Airframe frame = frame_of(1.0);
  std::vector<GroupMember> drones{
      flying(0, {{0, 0, 0}, Quat::Identity()}, {{3, 0, 0}, Vec3::Zero()}, &frame),
      flying(1, {{0.603F, 0, 0}, Quat::Identity()}, {}, &frame),
  };
  drones[1].is_fixed = true;
  GroupResolver resolver(pointed_drone());
  resolver.resolve(drones, contact_config(OnContact::bounce, 0.5F));
  EXPECT_NEAR(drones[0].velocity.linear.x(), -1.5F, 1e-5);
  EXPECT_FALSE(drones[1].is_deflected);
  EXPECT_EQ(drones[1].pose.position, Vec3(0.603F, 0, 0));
  EXPECT_TRUE(drones[1].contact.hit);
}

TEST(ContactGroup, DronesStopTogetherAtAContactThatTerminates) {
  const Airframe frame = frame_of(1.0);
  std::vector<GroupMember> drones{
      flying(0, {{0, 0, 0}, Quat::Identity()}, {{3, 0, 0}, Vec3::Zero()}, &frame),
      flying(1, {{0.604F, 0, 0}, Quat::Identity()}, {{-1, 0, 0}, Vec3::Zero()}, &frame),
      flying(2, {{1.2F, 0.1F, 0}, Quat::Identity()}, {}, &frame),
  };
  GroupResolver resolver(pointed_drone());
  resolver.resolve(drones, contact_config(OnContact::terminate));
  EXPECT_NEAR(drones[1].pose.position.x() - drones[0].pose.position.x(), 0.6001, 2e-6);
  EXPECT_NEAR(drones[0].pose.position.x() / (0.604F - drones[1].pose.position.x()), 3.0, 1e-2);
  EXPECT_TRUE(drones[0].is_deflected && drones[1].is_deflected);
  EXPECT_FALSE(drones[2].contact.hit);
}

// A row of drones at rest that one hits from the left: the last one flies off, as in Newton's cradle.
TEST(ContactGroup, ImpulsesPassThroughARow) {
  const Airframe frame = frame_of(1.0);
  std::vector<GroupMember> drones;
  constexpr std::uint32_t kCount = 4;
  for (std::uint32_t i = 0; i < kCount; ++i) {
    drones.push_back(flying(i, {{0.6015F * static_cast<float>(i), 0, 0}, Quat::Identity()},
                            {{i == 0 ? 6.0F : 0.0F, 0, 0}, Vec3::Zero()}, &frame));
  }
  GroupResolver resolver(pointed_drone());
  resolver.resolve(drones, contact_config(OnContact::bounce, 1.0F));
  for (std::uint32_t i = 0; i < kCount; ++i) {
    EXPECT_NEAR(drones[i].velocity.linear.x(), i + 1 == kCount ? 6.0F : 0.0F, 1e-4) << i;
  }
}

TEST(ContactGroup, TheOrderOfTheDronesDoesNotMatter) {
  Random random(2);
  const auto world = make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(2, 2, 1)),
                                 primitive(PrimitiveKind::box, {0.5F, 0, 0}, Vec3(0.2F, 0.2F, 1))});
  const collision::Obstacles& obstacles = prepared(*world).obstacles();
  GroupResolver resolver(box_drone());
  int contacts = 0;
  for (const OnContact on_contact : {OnContact::terminate, OnContact::bounce, OnContact::stop}) {
    for (int i = 0; i < 100; ++i) {
      const Airframe frames[] = {frame_of(0.5), frame_of(2.0)};
      std::vector<GroupMember> drones;
      for (std::uint32_t k = 0; k < 12; ++k) {
        const Vec3 place(random.within(-1.6F, 1.6F), random.within(-1.6F, 1.6F), random.within(-0.6F, 0.6F));
        drones.push_back(flying(k, {place, random.rotation()}, {random.point(60.0F), random.point(30.0F)}, &frames[k % 2]));
      }
      std::vector<GroupMember> shuffled(drones);
      std::ranges::shuffle(shuffled, random.generator());
      resolver.resolve(drones, contact_config(on_contact, 0.6F, 0.4F), obstacles);
      resolver.resolve(shuffled, contact_config(on_contact, 0.6F, 0.4F), obstacles);
      for (const GroupMember& drone : shuffled) {
        const GroupMember& same = drones[drone.number];
        contacts += drone.other >= 0;
        ASSERT_TRUE(same_outcome(drone, same));
        ASSERT_EQ(drone.other, same.other);
      }
    }
  }
  EXPECT_GT(contacts, 300);
}

// -- LaneGroup: state arrays are loaded to lanes and stored back, gathered or contiguous. Drones that are not stored keep their
// values.

using dynamics::DroneRange;
using dynamics::Flock;
using dynamics::kLanes;
using dynamics::LaneFlags;
using dynamics::LaneGroup;

constexpr std::size_t kNumDrones = 40;

// A state in which every element of every array has a different number.
State numbered_state() {
  State state = flight_state(kNumDrones, 1);
  float next = 1.0F;
  for_each_float_array(state, [&](const std::string&, std::vector<float>& array) {
    for (float& value : array) value = next++;
  });
  return state;
}

std::vector<DroneIndex> indices(std::initializer_list<int> drones) {
  std::vector<DroneIndex> list;
  for (const int drone : drones) list.emplace_back(drone);
  return list;
}

TEST(LaneGroup, TakesTheLanesThatFit) {
  const std::vector<DroneIndex> list = indices({3, 4, 9, 20, 38, 39});
  std::span<const DroneIndex> drones(list);
  const LaneGroup gathered(drones, {});
  EXPECT_TRUE(drones.empty());
  EXPECT_FALSE(gathered.is_row());
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(gathered[lane], list[std::min<std::size_t>(lane, 5)]);
    EXPECT_EQ(gathered.is_listed(lane), lane < 6);
  }

  drones = list;
  const DroneRange own{DroneIndex(2), 38};
  const LaneGroup row(drones, own);  // drones 3 to 18
  EXPECT_TRUE(row.is_row());
  EXPECT_EQ(drones.size(), 3U);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(row[lane], DroneIndex(3 + lane));
    EXPECT_EQ(row.is_listed(lane), lane == 0 || lane == 1 || lane == 6);
  }
  const LaneGroup last(drones, own);  // 20 to 35
  EXPECT_EQ(last[0], DroneIndex(20));
  const LaneGroup end(drones, own);
  EXPECT_TRUE(drones.empty());
  EXPECT_EQ(end[0], DroneIndex(24)) << "moved back to end with the range";
  EXPECT_TRUE(end.is_listed(14) && end.is_listed(15));
}

TEST(LaneGroup, LoadsTheSameGatheredAndContiguous) {
  const State state = numbered_state();
  std::vector<DroneIndex> list;
  for (std::size_t lane = 0; lane < kLanes; ++lane) list.emplace_back(5 + lane);
  Flock loaded[2];
  for (const bool is_row : {false, true}) {
    std::span<const DroneIndex> drones(list);
    const LaneGroup group(drones, is_row ? DroneRange{DroneIndex(0), kNumDrones} : DroneRange{});
    ASSERT_EQ(group.is_row(), is_row);
    group.load(state, loaded[is_row]);
  }
  EXPECT_EQ(std::memcmp(&loaded[0], &loaded[1], sizeof(Flock)), 0);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(loaded[0].origin[1][lane], state.position[3 * (5 + lane) + 1]);
    EXPECT_EQ(loaded[0].travelled[2][lane], state.flight.remainder[3 * (5 + lane) + 2]);
    EXPECT_EQ(loaded[0].rotor_command[3][lane], state.flight.rotor_command[4 * (5 + lane) + 3]);
    EXPECT_EQ(loaded[0].wind[0][lane], state.flight.wind[3 * (5 + lane)]);
  }
}

TEST(LaneGroup, StoresTheGivenLanesOnly) {
  const State before = numbered_state();
  const std::vector<DroneIndex> list = indices({5, 6, 8, 17, 20});
  for (const bool is_row : {false, true}) {
    State state = before;
    Flock flock;
    std::span<const DroneIndex> drones(list);
    const LaneGroup group(drones, is_row ? DroneRange{DroneIndex(0), kNumDrones} : DroneRange{});
    group.load(state, flock);
    for (auto* const lanes : {&flock.position, &flock.remainder, &flock.velocity, &flock.turn, &flock.error_integral,
                              &flock.acceleration, &flock.angular_acceleration}) {
      for (auto& lane : *lanes) lane.fill(-1.0F);
    }
    for (auto& lane : flock.rotation) lane.fill(-1.0F);
    for (auto* const lanes : {&flock.rotor, &flock.rotor_command}) {
      for (auto& lane : *lanes) lane.fill(-1.0F);
    }
    LaneFlags lanes{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      lanes[lane] = group.is_listed(lane) && (group[lane] == DroneIndex(6) || group[lane] == DroneIndex(17));
    }
    group.store(lanes, flock, state);
    int arrays = 0;
    for_each_float_array(std::as_const(state), before, [&](const std::string& name, const auto& values, const auto& old) {
      const bool is_stored = is_written_by_flight(name);
      arrays += is_stored;
      const std::size_t columns = values.size() / kNumDrones;
      for (std::size_t i = 0; i < values.size(); ++i) {
        const bool is_changed = is_stored && (i / columns == 6 || i / columns == 17);
        EXPECT_EQ(values[i], is_changed ? -1.0F : old[i]) << name << ' ' << i / columns;
      }
    });
    EXPECT_EQ(arrays, 10);
  }
}

TEST(LaneGroup, StoresOnlyOneLaneAndItsAccelerations) {
  const State before = numbered_state();
  const std::vector<DroneIndex> list = indices({7, 9});
  std::span<const DroneIndex> drones(list);
  const LaneGroup group(drones, {});
  Flock flock;
  group.load(before, flock);
  for (auto* const lanes : {&flock.position, &flock.remainder, &flock.acceleration, &flock.angular_acceleration}) {
    for (auto& lane : *lanes) lane.fill(-1.0F);
  }
  State one = before, accelerations = before;
  group.store(1, flock, one);
  group.store_accelerations(1, flock, accelerations);
  const auto row = [](const std::vector<float>& values, std::size_t drone) {
    const std::span<const float> found = testing::row(values, drone, 3);
    return std::vector<float>(found.begin(), found.end());
  };
  const std::vector<float> changed(3, -1.0F);
  EXPECT_EQ(row(one.position, 9), changed);
  EXPECT_EQ(row(one.flight.acceleration, 9), changed);
  EXPECT_EQ(row(one.flight.velocity, 9), row(before.flight.velocity, 9));
  EXPECT_EQ(row(one.position, 7), row(before.position, 7));
  EXPECT_EQ(row(accelerations.position, 9), row(before.position, 9));
  EXPECT_EQ(row(accelerations.flight.acceleration, 9), changed);
  EXPECT_EQ(row(accelerations.flight.angular_acceleration, 9), changed);
  EXPECT_EQ(row(accelerations.flight.acceleration, 7), row(before.flight.acceleration, 7));
}

}  // namespace
}  // namespace flockstep
