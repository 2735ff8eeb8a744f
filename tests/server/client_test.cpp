// The client against the server, in one process. Twins of the batch, which the test calls directly, give the expected values.
#include "flockstep/client.hpp"

#include "server/served.hpp"

namespace flockstep {
namespace {

using namespace serving;

template <class Config>
Config config_of(const std::string& fields) {
  Config config;
  read_config(nlohmann::json::parse(fields), "", config);
  return config;
}

std::vector<float> poses(const Batch& batch) { return {batch.state().position.begin(), batch.state().position.end()}; }

std::vector<float> flat(const std::vector<Vector3>& points) {
  std::vector<float> values;
  for (const Vector3& point : points) values.insert(values.end(), point.begin(), point.end());
  return values;
}

Vector3 location(const Batch& batch, std::size_t drone) {
  const auto row = testing::row(batch.state().position, drone, 3);
  return {row[0], row[1], row[2]};
}

TEST(Client, TellsWhatTheServerHas) {
  const Served served(kinematic());
  const Connection connection = served.connect();
  const client::ServerInfo& info = connection.server();
  EXPECT_EQ(info.version, FLOCKSTEP_VERSION);
  EXPECT_EQ(info.client, 1U);
  EXPECT_EQ(info.num_envs, 2);
  EXPECT_EQ(info.drones_per_env, 2);
  EXPECT_EQ(info.lidars, std::vector<std::string>{"lidar"});
  EXPECT_EQ(info.cameras, std::vector<std::string>{"front"});
  EXPECT_EQ(info.sensors, (std::vector<std::string>{"lidar", "front"}));
  EXPECT_FALSE(info.flies_by_rotors);
  EXPECT_FALSE(info.has_task);
  EXPECT_GT(info.step_s, 0.0);
  EXPECT_EQ(served.connect().server().client, 2U);
}

TEST(Client, MovesADrone) {
  Served served(kinematic());
  DroneController drone(served.connect(), 2);
  drone.ping();
  EXPECT_EQ(drone.get_location(), location(*served.twin, 2));

  std::vector<float> target = poses(*served.twin);
  const std::vector<std::uint8_t> third{0, 0, 1, 0};
  const auto move_twin = [&](const Vector3& to) {
    std::ranges::copy(to, target.begin() + 6);
    served.twin->move(target, {}, DroneMask(third));
  };
  for (const Vector3& to : {Vector3{0, 1, 1.5F}, Vector3{0, 0, 1}, Vector3{4, 0, 1}}) {  // the last one is behind the box
    const client::Impact impact = drone.set_location(to);
    move_twin(to);
    const auto& contact = served.twin->state().contact;
    EXPECT_EQ(impact.hit, contact.hit[2] != 0);
    EXPECT_EQ(impact.hit, to[0] > 3);
    EXPECT_EQ(impact.fraction, contact.fraction[2]);
    EXPECT_EQ(impact.location, location(*served.twin, 2));
    if (impact.hit) {
      EXPECT_TRUE(same_bits(impact.point, testing::row(contact.point, 2, 3)));
      EXPECT_TRUE(same_bits(impact.normal, testing::row(contact.normal, 2, 3)));
    }
    EXPECT_EQ(drone.get_location(), impact.location);
  }
  const client::Impact placed = drone.set_location({-2, -1, 1}, true);
  EXPECT_FALSE(placed.hit);
  EXPECT_EQ(placed.location, (Vector3{-2, -1, 1}));

  EXPECT_FALSE(drone.set_rotation(client::Angles{.yaw_deg = 90}).hit);
  client::Rotation rotation = drone.get_rotation();
  EXPECT_NEAR(rotation.quaternion[0], std::sqrt(0.5), 1e-6);
  EXPECT_NEAR(rotation.quaternion[3], std::sqrt(0.5), 1e-6);
  EXPECT_NEAR(rotation.angles.yaw_deg, 90, 1e-4);
  const client::Impact both = drone.set_location_and_rotation({-1, 0, 2}, client::Quaternion{1, 0, 0, 0}, true);
  EXPECT_EQ(both.location, (Vector3{-1, 0, 2}));
  EXPECT_EQ(both.rotation, (client::Quaternion{1, 0, 0, 0}));
  rotation = drone.get_rotation();
  EXPECT_EQ(rotation.quaternion, (client::Quaternion{1, 0, 0, 0}));
  EXPECT_EQ(drone.set_location_and_rotation({-1, 1, 2}, client::Angles{.yaw_deg = -90}).hit, false);
  EXPECT_NEAR(drone.get_rotation().angles.yaw_deg, -90, 1e-4);
}

TEST(Client, ScansWithTheLidar) {
  Served served(kinematic());
  DroneController drone(served.connect(), 1);
  drone.set_location_and_rotation({1, 2, 1}, client::Angles{.roll_deg = 20, .pitch_deg = 10, .yaw_deg = 70}, true);
  const client::LidarData scan = drone.get_lidar_data();
  const client::Quaternion q = drone.get_rotation().quaternion;
  std::vector<float> position = poses(*served.twin),
                     quat(served.twin->state().quat_wxyz.begin(), served.twin->state().quat_wxyz.end());
  std::ranges::copy(Vector3{1, 2, 1}, position.begin() + 3);
  std::ranges::copy(q, quat.begin() + 4);
  served.twin->set_pose(position, quat);
  std::vector<float> ranges(35), directions(3 * 35);
  served.twin->lidar().scan(DroneIndex(1), ranges);
  served.twin->lidar().directions(DroneIndex(1), directions);
  EXPECT_EQ(scan.channels, 1);
  EXPECT_EQ(scan.beams, 35);
  EXPECT_EQ(scan.ranges, ranges);
  EXPECT_EQ(flat(scan.directions), directions);
  EXPECT_EQ(scan.origin, (Vector3{1, 2, 1}));
  EXPECT_EQ(scan.rotation, q);

  served.twin->sense();
  std::vector<float> points(4 * 3 * 35);
  served.twin->lidar().points(points);
  const std::vector<float> got = flat(scan.points());
  ASSERT_EQ(got.size(), 3U * 35U);  // all beams hit the room
  for (std::size_t i = 0; i < got.size(); ++i) EXPECT_NEAR(got[i], points[3 * 35 + i], 1e-4) << i;

  const client::LidarData bare = drone.get_lidar_data("", true);
  EXPECT_EQ(bare.ranges, ranges);
  EXPECT_TRUE(bare.directions.empty());
  EXPECT_EQ(error_of([&] { static_cast<void>(bare.points()); }).code(), ErrorCode::invalid_argument);

  drone.set_lidar_config(
      R"({"channels": 3, "beams": 5, "hfov_deg": 90, "vfov_deg": 30, "max_range_m": 1, "offset_m": [0, 0, 0.5]})");
  const auto config = config_of<LidarConfig>(drone.get_lidar_config());
  EXPECT_EQ(config.channels, 3);
  EXPECT_EQ(config.beams, 5);
  EXPECT_EQ(config.hfov_deg, 90.0F);
  EXPECT_EQ(config.vfov_deg, 30.0F);
  EXPECT_EQ(config.max_range_m, 1.0F);
  EXPECT_EQ(config.offset_m, (Vector3{0, 0, 0.5F}));
  EXPECT_EQ(config.quat_wxyz, (client::Quaternion{1, 0, 0, 0}));
  const client::LidarData other = drone.get_lidar_data();
  EXPECT_EQ(other.channels, 3);
  EXPECT_EQ(other.ranges.size(), 15U);
  EXPECT_EQ(other.directions.size(), 15U);
  EXPECT_LT(other.points().size(), 15U);  // some are farther than 1 m
}

TEST(Client, TakesPictures) {
  Served served(kinematic());
  const Connection connection = served.connect();
  DroneController drone(connection, 0);
  GameModeController simulation(connection);
  const client::CameraData jpeg = drone.get_camera_data();
  served.twin->sense();
  const std::string expected = served.twin->camera(0).jpeg(DroneIndex(0), 90);
  EXPECT_EQ(jpeg.width_px, 32);
  EXPECT_EQ(jpeg.height_px, 24);
  EXPECT_TRUE(same_bits(jpeg.image.values<std::uint8_t>(), expected));
  const client::CameraData png = drone.get_camera_data({.camera = "front", .format = client::ImageFormat::png});
  EXPECT_EQ(png.image.values<std::uint8_t>()[1], 'P');
  EXPECT_EQ(error_of([&] { drone.get_camera_data({.quality = 101}); }).code(), ErrorCode::invalid_argument);
  const client::CameraData depth = drone.get_camera_data({.format = client::ImageFormat::raw, .output = "depth"});
  EXPECT_EQ(depth.image.shape[0], 24U);
  EXPECT_EQ(depth.image.shape[1], 32U);
  EXPECT_TRUE(same_bits(depth.image.values<float>(), testing::row(served.twin->camera(0).images().depth, 0, 32 * 24)));
  EXPECT_EQ(error_of([&] { static_cast<void>(depth.image.values<std::uint8_t>()); }).code(), ErrorCode::invalid_argument);

  EXPECT_EQ(simulation.get_camera_capture_mode(), client::CaptureMode::every_step);
  simulation.set_camera_capture_mode(client::CaptureMode::on_demand);
  EXPECT_EQ(simulation.get_camera_capture_mode("front"), client::CaptureMode::on_demand);

  EXPECT_FALSE(drone.get_move_line_visible());
  drone.set_move_line_visible(true);
  EXPECT_TRUE(drone.get_move_line_visible());
  EXPECT_FALSE(drone.get_beams_visible());
  drone.set_beams_visible(true);
  EXPECT_TRUE(drone.get_beams_visible());

  drone.set_camera_config(R"({"width_px": 16, "height_px": 12, "hfov_deg": 60})");
  const auto config = config_of<CameraConfig>(drone.get_camera_config());
  EXPECT_EQ(config.width_px, 16);
  EXPECT_EQ(config.height_px, 12);
  EXPECT_NEAR(config.hfov_deg.value(), 60, 1e-4);
  EXPECT_TRUE(config.outputs.rgb && config.outputs.depth && !config.outputs.normal);
  EXPECT_EQ(drone.get_camera_data().width_px, 16);
}

TEST(Client, SpawnsAndRemovesDrones) {
  Served served(kinematic(), {.ownership = true});
  const Connection first = served.connect(), second = served.connect();
  GameModeController simulation(first);
  EXPECT_EQ(simulation.get_drones().size(), 4U);
  simulation.remove_drone(3);
  EXPECT_EQ(simulation.get_drones().size(), 3U);
  EXPECT_EQ(error_of([&] { DroneController(first, 3).get_location(); }).code(), ErrorCode::not_found);
  const client::Drone drone = simulation.spawn_drone({.location = Vector3{1, 1, 1}, .env = 1, .claim = true});
  EXPECT_EQ(drone.drone, 3);
  EXPECT_EQ(drone.env, 1);
  EXPECT_EQ(drone.owner, 1U);
  EXPECT_EQ(DroneController(first, 3).get_location(), (Vector3{1, 1, 1}));
  EXPECT_EQ(simulation.get_drones()[3].owner, 1U);
  EXPECT_EQ(error_of([&] { DroneController(second, 3).set_location({0, 0, 1}); }).code(), ErrorCode::permission_denied);
  simulation.release(std::array<std::int64_t, 1>{3});
  EXPECT_FALSE(DroneController(second, 3).set_location({0, 1, 1}).hit);
  GameModeController(second).claim(std::array<std::int64_t, 2>{0, 3});
  EXPECT_EQ(simulation.get_drones()[0].owner, 2U);
  EXPECT_EQ(error_of([&] { simulation.remove_drone(0); }).code(), ErrorCode::permission_denied);
  // Growth would change the indices of drones.
  EXPECT_EQ(error_of([&] { simulation.spawn_drone(); }).code(), ErrorCode::failed_precondition);
  simulation.remove_drone(1);
  const client::Drone more = simulation.spawn_drone();
  EXPECT_EQ(more.drone, 1);
  EXPECT_EQ(DroneController(first, 1).get_location(), (Vector3{-1, 0, 1}));  // the start
}

TEST(Client, MovesAllDronesAtOnce) {
  Served served(kinematic());
  GameModeController simulation(served.connect());
  std::vector<float> position = poses(*served.twin);
  for (std::size_t drone = 0; drone < 4; ++drone) position[3 * drone] = static_cast<float>(drone) + 1.0F;
  const std::vector<std::uint8_t> mask{1, 1, 1, 0};
  const client::Readings moved = simulation.set_poses({.position = position, .mask = mask});
  served.twin->move(position, {}, DroneMask(mask));
  EXPECT_TRUE(same_bits(moved.values<float>("position"), served.twin->state().position));
  EXPECT_TRUE(same_bits(moved.values<bool>("hit"), served.twin->state().contact.hit));
  EXPECT_TRUE(moved.values<bool>("hit")[2]);  // the box
  EXPECT_EQ(moved.array("position").shape, (std::vector<std::size_t>{4, 3}));
  EXPECT_TRUE(same_bits(simulation.get_array("position").values<float>("position"), served.twin->state().position));
  const std::vector<std::string> names{"position", "quat_wxyz", "active"};
  const client::Readings arrays = simulation.get_arrays(names);
  EXPECT_EQ(arrays.arrays.size(), 3U);
  EXPECT_TRUE(same_bits(arrays.values<float>("quat_wxyz"), served.twin->state().quat_wxyz));
  EXPECT_EQ(error_of([&] { simulation.get_array("nothing"); }).code(), ErrorCode::invalid_argument);
  EXPECT_EQ(error_of([&] { static_cast<void>(arrays.array("hit")); }).code(), ErrorCode::not_found);

  simulation.sense();
  served.twin->sense();
  EXPECT_TRUE(same_bits(simulation.get_array("ranges", "lidar").values<float>("ranges"), served.twin->lidar().readings().ranges));

  const std::vector<float> quat{1, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 1, 0, 0, 0};
  const client::Readings placed = simulation.set_poses({.position = position, .quat_wxyz = quat}, true);
  EXPECT_TRUE(same_bits(placed.values<float>("position"), position));
}

TEST(Client, SpawnsAndMovesBodies) {
  BatchConfig config = kinematic();
  config.bodies = {BodyConfig{.name = "crate", .position_m = {2, 2, 1}}};
  config.max_bodies = 3;
  Served served(config);
  const Connection connection = served.connect();
  GameModeController simulation(connection);
  EXPECT_EQ(connection.server().bodies_per_env, 3);
  ASSERT_EQ(connection.server().array_rows.size(), connection.server().array_names.size());
  const auto row = std::ranges::find(connection.server().array_names, "body_position") - connection.server().array_names.begin();
  EXPECT_EQ(connection.server().array_rows[static_cast<std::size_t>(row)], "body");
  const BodyState& twin = served.twin->state().bodies;
  const auto expect_the_same = [&] {
    const std::vector<std::string> names{"body_active", "body_position", "body_quat_wxyz", "body_velocity",
                                         "body_angular_velocity"};
    const client::Readings got = simulation.get_arrays(names);
    EXPECT_EQ(got.array("body_quat_wxyz").shape, (std::vector<std::size_t>{2, 3, 4}));
    EXPECT_TRUE(same_bits(got.values<bool>("body_active"), twin.active));
    EXPECT_TRUE(same_bits(got.values<float>("body_position"), twin.position));
    EXPECT_TRUE(same_bits(got.values<float>("body_quat_wxyz"), twin.quat_wxyz));
    EXPECT_TRUE(same_bits(got.values<float>("body_velocity"), twin.velocity));
    EXPECT_TRUE(same_bits(got.values<float>("body_angular_velocity"), twin.angular_velocity));
  };
  expect_the_same();
  const BodyConfig ball{.name = "ball", .shape = BodyShape::sphere, .size_m = {0.5F, 0.5F, 0.5F}};
  const std::vector<float> at{1, 1, 1, 2, 2, 2}, turn{0, 1, 0, 0, 0, 1, 0, 0};
  const std::vector<std::uint8_t> second{0, 1};
  const std::string text = R"({"name": "ball", "shape": "sphere", "size_m": [0.5, 0.5, 0.5]})";
  EXPECT_EQ(simulation.spawn_bodies(text, {.position = at, .quat_wxyz = turn, .velocity = at, .angular_velocity = at}),
            served.twin->bodies().spawn(ball, at, turn, at, at));
  EXPECT_EQ(simulation.spawn_bodies(text, {.mask = second}), (std::vector<std::int64_t>{-1, 2}));
  served.twin->bodies().spawn(ball, {}, {}, {}, {}, EnvMask(second));
  expect_the_same();
  std::vector<float> places(18), quats(24, 0.5F);
  for (std::size_t i = 0; i < places.size(); ++i) places[i] = static_cast<float>(i) / 8.0F;
  const std::vector<std::uint8_t> some{1, 0, 0, 0, 1, 1};
  simulation.set_body_poses({.position = places, .quat_wxyz = quats, .mask = some});
  served.twin->bodies().set_pose(places, quats, some);
  expect_the_same();
  simulation.set_body_velocities({.velocity = places, .angular_velocity = places, .mask = some});
  served.twin->bodies().set_velocity(places, places, some);
  expect_the_same();
  const client::BodyConfigs configs = simulation.get_body_configs();
  EXPECT_EQ(configs.numbers, (std::vector<std::int32_t>{0, 1, -1, 0, 1, 1}));
  ASSERT_EQ(configs.configs.size(), 2U);
  EXPECT_NE(configs.configs[1].find(R"("name":"ball")"), std::string::npos);
  EXPECT_EQ(simulation.get_body_configs(std::array<std::int64_t, 1>{0}).numbers, (std::vector<std::int32_t>{0, 1, -1}));
  simulation.remove_bodies(some);
  served.twin->bodies().remove(some);
  expect_the_same();
  EXPECT_EQ(error_of([&] { simulation.spawn_bodies("{}", {.mask = std::array<std::uint8_t, 3>{}}); }).code(),
            ErrorCode::invalid_argument);
  EXPECT_EQ(error_of([&] { simulation.spawn_bodies(R"({"weight": 1})"); }).code(), ErrorCode::invalid_argument);
  EXPECT_EQ(error_of([&] { simulation.set_body_poses({.position = at}); }).code(), ErrorCode::invalid_argument);
  EXPECT_EQ(error_of([&] { simulation.get_body_configs(std::array<std::int64_t, 1>{2}); }).code(), ErrorCode::invalid_argument);
  simulation.remove_bodies();
  EXPECT_EQ(simulation.get_body_configs().numbers, std::vector<std::int32_t>(6, -1));
}

TEST(Client, StepsAndRestores) {
  Served served(rotors());
  const Connection connection = served.connect();
  GameModeController simulation(connection);
  EXPECT_TRUE(connection.server().flies_by_rotors);
  const std::vector<float> command{1, 0, 0, 0, 0, 1, 0, 0};
  EXPECT_EQ(simulation.fly({.command = command}).step, 0);
  served.twin->fly(command);
  EXPECT_TRUE(same_bits(simulation.get_array("position").values<float>("position"), served.twin->state().position));
  const std::vector<std::uint8_t> snapshot = simulation.snapshot();
  simulation.fly({.command = command}, 7, "velocity");
  served.twin->fly(command, 7);
  EXPECT_TRUE(same_bits(simulation.get_array("position").values<float>("position"), served.twin->state().position));
  simulation.restore(snapshot);
  served.twin->restore(std::string(snapshot.begin(), snapshot.end()));
  EXPECT_TRUE(same_bits(simulation.get_array("position").values<float>("position"), served.twin->state().position));
  EXPECT_EQ(error_of([&] { simulation.restore(std::vector<std::uint8_t>(100)); }).code(), ErrorCode::invalid_argument);

  simulation.set_command({.command = command});
  DroneController(connection, 1).set_command({0, 0, 1, 0}, "velocity");
  const client::Time time = simulation.step();
  EXPECT_EQ(time.step, 1);
  served.twin->fly(std::vector<float>{1, 0, 0, 0, 0, 0, 1, 0});
  EXPECT_TRUE(same_bits(simulation.get_array("position").values<float>("position"), served.twin->state().position));

  simulation.set_clock(500);
  EXPECT_EQ(error_of([&] { simulation.step(); }).code(), ErrorCode::failed_precondition);
  while (simulation.get_array("position").time.step < 5) std::this_thread::sleep_for(1ms);
  EXPECT_GT(simulation.get_fps().fps, 0.0);
  simulation.set_clock(0);
}

TEST(Client, FliesBySixRotors) {
  BatchConfig config = rotors();
  config.airframes = {"f550"};
  Served served(config);
  const Connection connection = served.connect();
  GameModeController simulation(connection);
  EXPECT_EQ(connection.server().num_rotors, 6);
  const std::array<float, 6> other{500, 520, 540, 560, 550, 530};
  std::vector<float> command{600, 590, 580, 570, 560, 550, 500, 510, 520, 530, 540, 550};
  simulation.fly({.command = command}, 7, "rotor_speeds");
  served.twin->fly(command, 7, {}, Control::rotor_speeds);
  simulation.set_command({.command = command}, {}, "rotor_speeds");
  DroneController(connection, 1).set_command(other, "rotor_speeds");
  simulation.step();
  std::ranges::copy(other, command.begin() + 6);
  served.twin->fly(command, 0, {}, Control::rotor_speeds);
  EXPECT_TRUE(same_bits(simulation.get_array("position").values<float>("position"), served.twin->state().position));
  const std::vector<float> four(4, 500.0F);
  EXPECT_EQ(error_of([&] { simulation.fly({.command = four}, 1, "rotor_speeds"); }).code(), ErrorCode::invalid_argument);
}

TEST(Client, ReadsWorlds) {
  Served served(kinematic());
  GameModeController simulation(served.connect());
  const std::vector<client::World> worlds = simulation.get_worlds();
  ASSERT_EQ(worlds.size(), 2U);
  const World& world = *served.twin->worlds()[0];
  EXPECT_EQ(worlds[0].content_hash, world.content_hash());
  EXPECT_EQ(worlds[0].start, (Vector3{-1, 0, 1}));
  EXPECT_TRUE(same_bits(worlds[0].max, std::span(world.bounds().max.data(), 3)));

  const client::Mesh mesh = simulation.get_mesh();
  std::vector<std::int32_t> of_object;
  const TriangleMesh expected = world.mesh(1e-3F, &of_object);
  EXPECT_EQ(mesh.objects, of_object);
  EXPECT_EQ(mesh.triangles.size(), expected.triangles.size());
  EXPECT_EQ(mesh.vertices.size(), expected.vertices.size());
  const client::PointCloud cloud = simulation.get_point_cloud(0.25F);
  const PointCloud sampled = point_cloud(world, 0.25F);
  EXPECT_EQ(cloud.points.size(), sampled.points.size());
  EXPECT_EQ(cloud.semantic, sampled.semantic);
  const client::Boxes boxes = simulation.get_boxes();
  EXPECT_EQ(boxes.materials, objects(world).materials);

  simulation.set_light(R"({"sun_direction": [0, 0, 1], "sun_color": [0.5, 0.25, 0]})");
  const auto light = config_of<Light>(simulation.get_light());
  EXPECT_EQ(light.sun_direction, (Vector3{0, 0, 1}));
  EXPECT_EQ(light.sun_color, (Vector3{0.5F, 0.25F, 0}));
  EXPECT_EQ(light.sky_ambient, world.light().sky_ambient);
  EXPECT_EQ(light.gamma, world.light().gamma);
  simulation.set_light(R"({"sun_glow": 0.25, "fog_visibility_m": 16})", 0, std::array<std::int64_t, 1>{1});
  EXPECT_EQ(config_of<Light>(simulation.get_light(0, 1)).fog_visibility_m, 16.0F);
  EXPECT_EQ(config_of<Light>(simulation.get_light(0, 1)).sun_glow, 0.25F);
  EXPECT_EQ(config_of<Light>(simulation.get_light(0, 1)).sun_color, light.sun_color);
  EXPECT_EQ(config_of<Light>(simulation.get_light(0, 0)).fog_visibility_m, 0.0F);
  EXPECT_EQ(error_of([&] { simulation.set_light(R"({"gamma": 2})", 0, std::array<std::int64_t, 1>{9}); }).code(),
            ErrorCode::not_found);
  EXPECT_EQ(error_of([&] { static_cast<void>(simulation.get_light(0, -1)); }).code(), ErrorCode::not_found);
  EXPECT_EQ(error_of([&] { simulation.set_light(R"({"sun": 2})"); }).code(), ErrorCode::invalid_argument);
  simulation.set_light("", 0, std::array<std::int64_t, 1>{1});
  EXPECT_EQ(config_of<Light>(simulation.get_light(0, 1)).fog_visibility_m, 0.0F);

  simulation.set_world(1, 1);
  EXPECT_EQ(simulation.get_array("world_index").values<std::int32_t>("world_index")[1], 1);
  EXPECT_EQ(error_of([&] { simulation.set_world(0, 2); }).code(), ErrorCode::not_found);
}

}  // namespace
}  // namespace flockstep
