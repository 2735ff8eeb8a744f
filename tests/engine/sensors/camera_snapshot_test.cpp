// Cameras of a batch that change at run time, their files and snapshots, and bad input.
#include "sensors/captures.hpp"

namespace flockstep {
namespace {

using namespace captures;

// -- Changes at run time.

std::shared_ptr<const World> gallery() {
  return make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {5, 4, 3}),
                     primitive(PrimitiveKind::box, {3, 1, 0}, {0.5F, 0.7F, 1}, Quat(0.8F, 0.2F, -0.4F, 0.4F).normalized()),
                     primitive(PrimitiveKind::cylinder, {2, -1, -1}, {0.5F, 0.5F, 1.5F}),
                     primitive(PrimitiveKind::sphere, {0, -2, 1}, {0.8F, 0.8F, 0.8F})});
}

TEST(CameraChange, EqualsASensorMadeThatWay) {
  CameraConfig base{.width_px = 24, .height_px = 18, .hfov_deg = 70.0F, .vfov_deg = 50.0F, .outputs = kAllOutputs};
  CameraConfig across = base;
  across.hfov_deg = 100.0F;
  across.vfov_deg.reset();  // setting one resets the other
  CameraConfig up = base;
  up.hfov_deg.reset();
  up.vfov_deg = 30.0F;
  CameraConfig both = base;
  both.hfov_deg = 40.0F;
  both.vfov_deg = 80.0F;
  CameraConfig moved = base;
  moved.offset_m = {0.4F, 0.2F, -0.3F};
  CameraConfig turned = base;
  turned.quat_wxyz = {0.6F, 0, 0.8F, 0};
  const std::vector<CameraConfig> configs{base, across, up, both, moved, turned, base, across};
  Batch batch(camera_batch(base, 8), {gallery()});
  const auto only = [](std::size_t drone) {
    Flags mask(8, 0);
    mask[drone] = 1;
    return mask;
  };
  batch.camera(0).set({.hfov_deg = 100.0F}, only(1));
  batch.camera(0).set({.vfov_deg = 30.0F}, only(2));
  batch.camera(0).set({.hfov_deg = 40.0F, .vfov_deg = 80.0F}, only(3));
  batch.camera(0).set({.offset_m = moved.offset_m}, only(4));
  batch.camera(0).set({.quat_wxyz = turned.quat_wxyz}, only(5));
  // Changed, then changed back.
  batch.camera(0).set({.hfov_deg = 20.0F, .offset_m = {{1, 1, 1}}, .quat_wxyz = {{0, 1, 0, 0}}}, only(6));
  batch.camera(0).set({.hfov_deg = 70.0F, .vfov_deg = 50.0F, .offset_m = {{0, 0, 0}}, .quat_wxyz = {{1, 0, 0, 0}}}, only(6));
  batch.camera(0).set({.vfov_deg = 33.0F}, only(7));  // sets vfov_deg; the next call resets it
  batch.camera(0).set({.hfov_deg = 100.0F}, only(7));
  const std::vector<float> pose{0.5F, 0.25F, -0.5F};
  std::vector<float> poses;
  for (int i = 0; i < 8; ++i) poses.insert(poses.end(), pose.begin(), pose.end());
  batch.set_pose(poses, {});
  batch.sense();
  const CameraImages& images = batch.camera(0).images();
  const std::size_t pixels = std::size_t{24} * 18;
  for (std::size_t drone = 0; drone < 8; ++drone) {
    SCOPED_TRACE(drone);
    const CameraConfig is = batch.camera(0).config(DroneIndex(drone));
    EXPECT_EQ(is.hfov_deg, configs[drone].hfov_deg);
    EXPECT_EQ(is.vfov_deg, configs[drone].vfov_deg);
    EXPECT_EQ(is.offset_m, configs[drone].offset_m);
    EXPECT_EQ(is.quat_wxyz, configs[drone].quat_wxyz);
    Batch made_so(camera_batch(configs[drone]), {gallery()});
    made_so.set_pose(pose, {});
    made_so.sense();
    EXPECT_TRUE(same_bits(row(images.rgb, drone, 3 * pixels), made_so.camera(0).images().rgb));
    EXPECT_TRUE(same_bits(row(images.depth, drone, pixels), made_so.camera(0).images().depth));
    EXPECT_TRUE(same_bits(row(images.normal, drone, 3 * pixels), made_so.camera(0).images().normal));
    EXPECT_GT(expect_picture(batch, drone, 0, 3).clear, 100U);
    // Each change must be visible, otherwise the comparison proves nothing.
    EXPECT_EQ(same_bits(row(images.depth, drone, pixels), row(images.depth, 0, pixels)), drone == 0 || drone == 6);
  }
}

TEST(CameraChange, MarksFramesStaleAndRendersThemWhenTheyAreDue) {
  for (const CaptureMode mode : {CaptureMode::every_step, CaptureMode::on_movement, CaptureMode::on_demand}) {
    Batch batch(probes(3, mode), {halls()[0]});
    put(batch, {1, 2, 3});
    batch.sense();
    batch.camera(0).capture();
    batch.camera(0).set({.offset_m = {{0.5F, 0, 0}}}, Flags{0, 1, 0});
    EXPECT_EQ(frame_step(batch), (Steps{0, -1, 0}));
    smear(batch);
    batch.sense();
    const bool every = mode == CaptureMode::every_step;
    const bool demand = mode == CaptureMode::on_demand;
    EXPECT_EQ(frame_step(batch), (Steps{every ? 1 : 0, demand ? -1 : 1, every ? 1 : 0}));
    EXPECT_EQ(is_smeared(batch, 0), !every);
    EXPECT_EQ(is_smeared(batch, 1), demand);
    batch.camera(0).capture();
    EXPECT_EQ(shown(batch), (std::vector<float>{1, 2.5F, 3}));
  }
}

TEST(CameraChange, ARemovedDroneKeepsItsCamera) {
  Batch batch(probes(2, CaptureMode::every_step), {halls()[0]});
  batch.remove(std::vector<std::int64_t>{1});
  batch.camera(0).set({.offset_m = {{0.5F, 0, 0}}});
  batch.spawn(std::vector<std::int64_t>{1}, std::vector<float>{2, 0, 0}, {}, {});
  EXPECT_EQ(shown(batch)[1], 2.0F);
  EXPECT_EQ(batch.camera(0).config(DroneIndex(0)).offset_m[0], 0.5F);
}

// -- Bad input.

TEST(CameraRefusal, OfEveryFieldOfTheConfiguration) {
  const std::vector<std::pair<std::function<void(CameraConfig&)>, std::string>> cases{
      {[](CameraConfig& c) { c.name = ""; }, R"(camera.name: ... "")"},
      {[](CameraConfig& c) { c.name = "../front"; }, R"(camera.name: ... "../front")"},
      {[](CameraConfig& c) { c.width_px = 0; }, "camera.width_px: ... [1, 8192] ... 0"},
      {[](CameraConfig& c) { c.width_px = 8193; }, "camera.width_px: ... [1, 8192] ... 8193"},
      {[](CameraConfig& c) { c.height_px = -4; }, "camera.height_px: ... [1, 8192] ... -4"},
      {[](CameraConfig& c) { c.height_px = 1 << 30; }, "camera.height_px: ... [1, 8192] ... 1073741824"},
      {[](CameraConfig& c) { c.hfov_deg = 0.0F; }, "camera.hfov_deg: ... [0.1, 179] ... 0"},
      {[](CameraConfig& c) { c.hfov_deg = 180.0F; }, "camera.hfov_deg: ... [0.1, 179] ... 180"},
      {[&](CameraConfig& c) { c.hfov_deg = kNan; }, "camera.hfov_deg: ... [0.1, 179] ... nan"},
      {[](CameraConfig& c) { c.vfov_deg = 0.0F; }, "camera.vfov_deg: ... [0.1, 179] ... 0"},
      {[](CameraConfig& c) { c.vfov_deg = -90.0F; }, "camera.vfov_deg: ... [0.1, 179] ... -90"},
      {[](CameraConfig& c) { c.hfov_deg = 90.0F, c.vfov_deg = 180.0F; }, "camera.vfov_deg: ... [0.1, 179] ... 180"},
      {[](CameraConfig& c) { c.width_px = 8000, c.height_px = 10, c.vfov_deg = 150.0F; }, "camera.vfov_deg: ... 179"},
      {[](CameraConfig& c) { c.width_px = 10, c.height_px = 8000, c.hfov_deg = 150.0F; }, "camera.hfov_deg: ... 179"},
      {[&](CameraConfig& c) { c.offset_m[1] = kNan; }, "camera.offset_m[1]: ... +-100 ... nan"},
      {[](CameraConfig& c) { c.offset_m[2] = -1e30F; }, "camera.offset_m[2]: ... +-100 ... -1e+30"},
      {[](CameraConfig& c) { c.quat_wxyz = {0, 0, 0, 0}; }, "camera.quat_wxyz: ... quaternion"},
      {[&](CameraConfig& c) { c.quat_wxyz[3] = kNan; }, "camera.quat_wxyz: ... quaternion"},
      {[](CameraConfig& c) { c.near_m = 0.0F; }, "camera.near_m: ... 0 ... 0"},
      {[&](CameraConfig& c) { c.near_m = kNan; }, "camera.near_m: ... 0 ... nan"},
      {[](CameraConfig& c) { c.near_m = 5.0F, c.far_m = 5.0F; }, "camera.far_m: ... number"},
      {[](CameraConfig& c) { c.far_m = 0.01F; }, "camera.far_m: ... number"},
      {[](CameraConfig& c) { c.far_m = kInfinity; }, "camera.far_m: ... 0 ... 1000000 ... inf"},
      {[&](CameraConfig& c) { c.far_m = kNan; }, "camera.far_m: ... 0 ... 1000000 ... nan"},
      {[](CameraConfig& c) { c.far_m = 2e6F; }, "camera.far_m: ... 0 ... 1000000 ... 2e+06"},
      {[](CameraConfig& c) { c.outputs = {.rgb = false}; }, "camera.outputs: ... one"},
      {[](CameraConfig& c) { c.samples_per_pixel = 0; }, "camera.samples_per_pixel: expected 1, 4, 9 or 16, got 0"},
      {[](CameraConfig& c) { c.samples_per_pixel = 3; }, "camera.samples_per_pixel: expected 1, 4, 9 or 16, got 3"},
      {[](CameraConfig& c) { c.samples_per_pixel = 25; }, "camera.samples_per_pixel: expected 1, 4, 9 or 16, got 25"},
  };
  for (const auto& [spoil, message] : cases) {
    CameraConfig camera;
    spoil(camera);
    EXPECT_REFUSED(camera.validate(), message);
    EXPECT_REFUSED(Batch(camera_batch(camera), halls()), message);
  }
  EXPECT_NO_THROW(CameraConfig().validate());
  EXPECT_NO_THROW((CameraConfig{.width_px = 1, .height_px = 8192, .vfov_deg = 179.0F}).validate());
  EXPECT_NO_THROW((CameraConfig{.width_px = 8192, .height_px = 1, .hfov_deg = 0.1F}).validate());
}

TEST(CameraRefusal, OfTwoOfOneNameAndOfTooManyPixels) {
  BatchConfig config = probes(1, CaptureMode::every_step);
  config.cameras.push_back(config.cameras[0]);
  EXPECT_REFUSED(Batch(config, halls()), R"(camera.name: ... "front")");
  config = camera_batch({.width_px = 8192, .height_px = 8192}, 65);
  EXPECT_REFUSED(config.validate(), "num_drones x camera pixels: ... 4294967296");
}

TEST(CameraRefusal, OfMoreInstancesThanHaveNumbers) {
  SceneDescription description;
  for (int i = 0; i < 65535; ++i) {
    description.primitives.push_back(primitive(PrimitiveKind::sphere, {static_cast<float>(i), 0, 0}, {0.1F, 0.1F, 0.1F}));
  }
  const auto full = std::make_shared<const World>(description);
  description.markers.goal = Vec3(0, 3, 0);
  const auto over = std::make_shared<const World>(description);
  CameraConfig camera{.width_px = 1, .height_px = 1, .outputs = {.rgb = true, .instance = true}};
  EXPECT_REFUSED(Batch(camera_batch(camera), {over}), "camera.outputs.instance: ... 65535");
  // The last instance id is used.
  camera.quat_wxyz = {0, 0, 0, 1};
  const auto batch = testing::look(full, camera, {65534.5F, 0, 0});
  EXPECT_EQ(batch->camera(0).images().instance[0], 65535);
  camera.outputs.instance = false;
  EXPECT_NO_THROW(Batch(camera_batch(camera), {over}));
}

TEST(CameraRefusal, ChangesNothing) {
  CameraConfig camera{.width_px = 8, .height_px = 6, .outputs = {.rgb = true, .depth = true}};
  BatchConfig config = camera_batch(camera, 2);
  camera.name = "depth";
  camera.outputs = {.rgb = false, .depth = true};
  config.cameras.push_back(camera);
  Batch batch(config, {gallery()});
  batch.sense();
  const std::string before = batch.snapshot();
  const CameraImages frames = batch.camera(0).images();
  for (const Flags& mask : {Flags{}, Flags{1, 0}, Flags{0, 0}}) {
    EXPECT_REFUSED(batch.camera(0).set({.hfov_deg = 0.0F}, mask), "camera.hfov_deg");
    EXPECT_REFUSED(batch.camera(0).set({.hfov_deg = 60.0F, .vfov_deg = 180.0F}, mask), "camera.vfov_deg");
    EXPECT_REFUSED(batch.camera(0).set({.vfov_deg = 178.9F}, mask), "camera.vfov_deg");  // hfov_deg would exceed its limit
    EXPECT_REFUSED(batch.camera(0).set({.hfov_deg = 60.0F, .offset_m = {{0, kNan, 0}}}, mask), "camera.offset_m");
    EXPECT_REFUSED(batch.camera(0).set({.quat_wxyz = {{0, 0, 0, 0}}}, mask), "camera.quat_wxyz");
    EXPECT_REFUSED(batch.camera(2).set({.hfov_deg = 60.0F}, mask), "camera: ... 2 ... 2");
    EXPECT_REFUSED(batch.camera(2).capture(mask), "camera: ... 2 ... 2");
  }
  EXPECT_REFUSED(batch.camera(0).set({.hfov_deg = 60.0F}, Flags{1}), "mask: ... 2 ... 1");
  EXPECT_REFUSED(batch.camera(0).capture(Flags{1, 0, 1}), "mask: ... 2 ... 3");
  EXPECT_REFUSED(batch.camera(7).set_capture_mode(CaptureMode::on_demand), "camera: ... 2 ... 7");
  EXPECT_REFUSED((void)batch.camera(2).images(), "camera: ... 2 ... 2");
  EXPECT_REFUSED((void)batch.camera(2).config(DroneIndex(0)), "camera: ... 2 ... 2");
  EXPECT_REFUSED((void)batch.camera(0).config(DroneIndex(2)), "index: ... [0, 2) ... 2");
  EXPECT_REFUSED((void)batch.camera("back").index(), R"(camera: ... "front" ... "depth" ... "back")");
  EXPECT_REFUSED((void)batch.camera(2).jpeg(DroneIndex(0), 90), "camera: ... 2 ... 2");
  EXPECT_REFUSED((void)batch.camera(1).jpeg(DroneIndex(0), 90), R"(camera: ... "depth")");
  EXPECT_REFUSED((void)batch.camera(0).jpeg(DroneIndex(2), 90), "index: ... [0, 2) ... 2");
  EXPECT_REFUSED((void)batch.camera(0).jpeg(DroneIndex(0), 0), "quality: ... [1, 100] ... 0");
  EXPECT_REFUSED((void)batch.camera(0).jpeg(DroneIndex(0), 101), "quality: ... [1, 100] ... 101");
  EXPECT_TRUE(batch.snapshot() == before);
  EXPECT_EQ(batch.camera(0).images().rgb, frames.rgb);
  EXPECT_EQ(batch.camera(0).images().frame_step, frames.frame_step);

  Batch blind(lidar_batch(1), {gallery()});
  EXPECT_REFUSED((void)blind.camera("front").index(),
                 "this Batch has no camera: give it one (cameras=[...]; a Task declares camera)");
  EXPECT_REFUSED((void)blind.camera(0).images(), "camera");
  EXPECT_EQ(blind.camera_backend_report(), "this Batch has no cameras");
}

// -- Files.

TEST(CameraJpeg, EncodesTheFrame) {
  for (const bool grey : {false, true}) {
    CameraConfig camera{.width_px = 50, .height_px = 30, .outputs = {.rgb = !grey, .grey = grey}};
    const auto batch = testing::look(gallery(), camera, {0, 0, 0});
    const std::string fine = batch->camera(0).jpeg(DroneIndex(0), 95);
    EXPECT_EQ(fine.substr(0, 2), "\xFF\xD8");
    EXPECT_EQ(fine.substr(fine.size() - 2), "\xFF\xD9");
    EXPECT_GT(fine.size(), batch->camera(0).jpeg(DroneIndex(0), 20).size());
    // The frame header: SOF0, length, precision, height, width, number of components.
    const std::size_t header = fine.find("\xFF\xC0");
    ASSERT_NE(header, std::string::npos);
    const auto byte = [&](std::size_t i) { return static_cast<int>(static_cast<unsigned char>(fine[header + i])); };
    EXPECT_EQ(256 * byte(5) + byte(6), 30);
    EXPECT_EQ(256 * byte(7) + byte(8), 50);
    EXPECT_EQ(byte(9), grey ? 1 : 3);
  }
}

TEST(CameraJpeg, OfAStaleFrameIsRefused) {
  Batch batch(camera_batch({.width_px = 8, .height_px = 8, .capture_mode = CaptureMode::on_demand}, 2), halls());
  const std::string message = "index: ... 1";
  EXPECT_REFUSED((void)batch.camera(0).jpeg(DroneIndex(1), 90), message);
  batch.camera(0).capture(Flags{1, 0});
  EXPECT_NO_THROW((void)batch.camera(0).jpeg(DroneIndex(0), 90));
  EXPECT_REFUSED((void)batch.camera(0).jpeg(DroneIndex(1), 90), message);
}

TEST(CameraJpeg, OfEitherLayoutIsTheSame) {
  CameraConfig camera{.width_px = 33, .height_px = 17};
  const std::string last = testing::look(gallery(), camera, {0, 0, 0})->camera(0).jpeg(DroneIndex(0), 90);
  camera.layout = ImageLayout::chw;
  EXPECT_EQ(testing::look(gallery(), camera, {0, 0, 0})->camera(0).jpeg(DroneIndex(0), 90), last);
}

// -- Snapshots.

NavigationBatch two_cameras(CaptureMode mode) {
  NavigationBatch config = flying(AutoresetMode::same_step, mode);
  config.cameras[0].outputs = kAllOutputs;
  config.cameras.push_back({.name = "other",
                            .width_px = 17,
                            .height_px = 5,
                            .vfov_deg = 40.0F,
                            .outputs = {.rgb = true, .depth = true},
                            .layout = ImageLayout::chw,
                            .capture_mode = CaptureMode::on_demand,
                            .samples_per_pixel = 4,
                            .shadows = true});
  return config;
}

// Compares the valid frames bit for bit, and which frames are valid.
::testing::AssertionResult same_frames(const Batch& a, const Batch& b) {
  for (std::size_t camera = 0; camera < a.config().cameras.size(); ++camera) {
    const CameraImages& x = a.camera(camera).images();
    const CameraImages& y = b.camera(camera).images();
    const CameraConfig& config = a.camera(camera).config();
    if (config.capture_mode != b.camera(camera).config().capture_mode) return ::testing::AssertionFailure() << "another mode";
    if (x.frame_step != y.frame_step) return ::testing::AssertionFailure() << "camera " << camera << ": other ages";
    const auto pixels = static_cast<std::size_t>(config.width_px * config.height_px);
    for (std::size_t i = 0; i < x.frame_step.size(); ++i) {
      const CameraConfig mine = a.camera(camera).config(DroneIndex(i));
      const CameraConfig other = b.camera(camera).config(DroneIndex(i));
      if (mine.hfov_deg != other.hfov_deg || mine.vfov_deg != other.vfov_deg || mine.offset_m != other.offset_m ||
          mine.quat_wxyz != other.quat_wxyz || mine.capture_mode != other.capture_mode) {
        return ::testing::AssertionFailure() << "camera " << camera << " of drone " << i << " is set otherwise";
      }
      if (x.frame_step[i] < 0) continue;
      const auto same = [&](const auto& p, const auto& q, std::size_t values) {
        return p.size() == q.size() && (p.empty() || same_bits(row(p, i, values * pixels), row(q, i, values * pixels)));
      };
      if (!same(x.rgb, y.rgb, 3) || !same(x.depth, y.depth, 1) || !same(x.semantic, y.semantic, 1) ||
          !same(x.instance, y.instance, 1) || !same(x.normal, y.normal, 3) || !same(x.grey, y.grey, 1)) {
        return ::testing::AssertionFailure() << "camera " << camera << ": the frame of drone " << i << " differs";
      }
    }
  }
  return ::testing::AssertionSuccess();
}

TEST(CameraSnapshot, RestoredIsUninterrupted) {
  const Batch::Worlds worlds{closet(), smaller_closet()};
  for (const CaptureMode mode : {CaptureMode::every_step, CaptureMode::on_movement, CaptureMode::on_demand}) {
    SCOPED_TRACE(static_cast<int>(mode));
    Batch one = two_cameras(mode).make(worlds);
    Random random(9);
    const auto fly = [&](const std::vector<Batch*>& batches, int steps) {
      for (int i = 0; i < steps; ++i) {
        const std::vector<float> actions = random_actions(random);
        Flags some(kEnvs);
        for (auto& flag : some) flag = random.generator()() % 4 == 0;
        for (Batch* batch : batches) {
          batch->step(std::span<const float>(actions));
          batch->camera(1).capture(some);
        }
      }
    };
    one.reset({});
    fly({&one}, 20);
    one.camera(0).capture();
    one.camera(0).set({.hfov_deg = 50.0F, .offset_m = {{0.1F, 0, 0.05F}}}, Flags{0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0});
    one.camera(1).set({.vfov_deg = 60.0F, .quat_wxyz = {{0.6F, 0, 0.8F, 0}}}, Flags{0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0});
    one.remove(std::vector<std::int64_t>{5});
    fly({&one}, 3);
    one.camera(0).set({.hfov_deg = 100.0F}, Flags{0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0});  // stale
    one.camera(1).set_capture_mode(CaptureMode::on_movement);
    std::vector<std::int32_t> swapped(one.state().world_index);
    swapped[7] = 1 - swapped[7];
    one.set_world(swapped);  // the frame still shows its old world
    const std::string blob = one.snapshot();

    NavigationBatch config = two_cameras(mode);
    config.num_threads = 2;
    config.block_size = 5;
    Batch fresh = config.make(worlds);
    Batch lived = config.make(worlds);
    lived.reset({});
    lived.camera(0).set({.hfov_deg = 33.0F});
    lived.camera(0).set_capture_mode(CaptureMode::on_demand);
    lived.remove(std::vector<std::int64_t>{1, 5});
    for (Batch* batch : {&fresh, &lived}) {
      batch->restore(blob);
      EXPECT_TRUE(same_frames(one, *batch));
      EXPECT_TRUE(batch->snapshot() == blob);
      // A removed drone has an empty frame, no matter what was there before.
      for (const float depth : row(batch->camera(0).images().depth, 5, 63)) EXPECT_EQ(depth, kInfinity);
    }
    const auto counting =
        std::count_if(frame_step(one, 1).begin(), frame_step(one, 1).end(), [](auto step) { return step >= 0; });
    EXPECT_GT(counting, 2);
    EXPECT_LT(counting, static_cast<std::ptrdiff_t>(kEnvs) - 1);
    for (int i = 0; i < 40; ++i) {
      fly({&one, &fresh, &lived}, 1);
      ASSERT_TRUE(same_frames(one, fresh)) << i;
      ASSERT_TRUE(same_frames(one, lived)) << i;
      ASSERT_TRUE(same_drones(one, fresh)) << i;
    }
  }
}

TEST(CameraSnapshot, RestoresItsMode) {
  Batch batch(probes(1, CaptureMode::every_step), {halls()[0]});
  batch.camera(0).set_capture_mode(CaptureMode::on_movement);
  const std::string blob = batch.snapshot();
  batch.camera(0).set_capture_mode(CaptureMode::on_demand);
  batch.restore(blob);
  EXPECT_EQ(batch.camera(0).config(DroneIndex(0)).capture_mode, CaptureMode::on_movement);
  EXPECT_EQ(batch.camera(0).config().capture_mode, CaptureMode::on_movement);
  // The capture mode is not part of the configuration that a snapshot must match.
  Batch other(probes(1, CaptureMode::on_demand), {halls()[0]});
  other.restore(blob);
  EXPECT_EQ(other.camera(0).config().capture_mode, CaptureMode::on_movement);
}

TEST(CameraSnapshot, OfAnotherCameraIsRefused) {
  const std::vector<std::function<void(NavigationBatch&)>> changes{
      [](NavigationBatch& c) { c.cameras.pop_back(); },
      [](NavigationBatch& c) { std::swap(c.cameras[0], c.cameras[1]); },
      [](NavigationBatch& c) { c.cameras[0].name = "face"; },
      [](NavigationBatch& c) { c.cameras[0].width_px = 7, c.cameras[0].height_px = 9; },
      [](NavigationBatch& c) { c.cameras[0].hfov_deg = 91.0F; },
      [](NavigationBatch& c) { c.cameras[1].vfov_deg = 41.0F; },
      [](NavigationBatch& c) { c.cameras[0].vfov_deg = 60.0F, c.cameras[0].hfov_deg = 90.0F; },
      [](NavigationBatch& c) { c.cameras[0].offset_m[2] = 0.1F; },
      [](NavigationBatch& c) { c.cameras[0].quat_wxyz = {0, 1, 0, 0}; },
      [](NavigationBatch& c) { c.cameras[0].near_m = 0.06F; },
      [](NavigationBatch& c) { c.cameras[0].far_m = 99.0F; },
      [](NavigationBatch& c) { c.cameras[0].outputs.grey = false; },
      [](NavigationBatch& c) { c.cameras[1].outputs.normal = true; },
      [](NavigationBatch& c) { c.cameras[0].depth_kind = DepthKind::range; },
      [](NavigationBatch& c) { c.cameras[0].layout = ImageLayout::chw; },
      [](NavigationBatch& c) { c.cameras[0].samples_per_pixel = 9; },
      [](NavigationBatch& c) { c.cameras[0].shadows = true; },
      [](NavigationBatch& c) { c.cameras[0].rate_hz = 5.0F; },
  };
  const Batch::Worlds worlds{closet()};
  Batch batch = two_cameras(CaptureMode::every_step).make(worlds);
  batch.reset({});
  const std::string before = batch.snapshot();
  for (std::size_t i = 0; i < changes.size(); ++i) {
    SCOPED_TRACE("change " + std::to_string(i));
    NavigationBatch config = two_cameras(CaptureMode::every_step);
    changes[i](config);
    EXPECT_REFUSED(batch.restore(config.make(worlds).snapshot()), "snapshot");
    EXPECT_TRUE(batch.snapshot() == before);
  }
  EXPECT_NO_THROW(batch.restore(two_cameras(CaptureMode::every_step).make(worlds).snapshot()));
}

// Without a task, the camera data is the end of a snapshot: the mode, settings of 76 bytes per drone, and seven arrays with
// the place and time of the frames. Each is preceded by its length.
TEST(CameraSnapshot, DamagedOnesAreRefusedAndChangeNothing) {
  constexpr std::size_t kDrones = 3, kSetting = 40 + sizeof(RangeErrors);
  Batch batch(probes(kDrones, CaptureMode::every_step), halls());
  put(batch, {1, 2, 3});
  batch.sense();
  const std::string blob = batch.snapshot();
  const std::size_t ages = blob.size() - 4 * kDrones;
  const std::size_t steps = ages - 8 - 8 * kDrones;
  const std::size_t drones = steps - 8 - 8 * kDrones;
  const std::size_t bodies = drones - 8 - 8 * kDrones;
  const std::size_t ticks = bodies - 8 - 8 * kDrones;
  const std::size_t worlds = ticks - 8 - 4 * kDrones;
  const std::size_t positions = worlds - 8 - 16 * kDrones - 8 - 12 * kDrones;
  const std::size_t settings = positions - 8 - kSetting * kDrones;
  const std::size_t mode = settings - 8 - 1;
  const auto expect_refused = [&](std::size_t at, const auto& value, const std::string& field) {
    std::string damaged = blob;
    std::memcpy(damaged.data() + at, &value, sizeof(value));
    EXPECT_REFUSED(batch.restore(damaged), "bytes that match their checksum");
    EXPECT_REFUSED(batch.restore(mended(damaged)), field);
    EXPECT_TRUE(batch.snapshot() == blob) << "a refused blob changed the batch";
  };
  float x = 0.0F;
  std::memcpy(&x, blob.data() + positions + 12, sizeof(x));
  ASSERT_EQ(x, 2.0F) << "the layout is another than this test knows";
  ASSERT_EQ(blob[mode], 0);
  expect_refused(worlds + 4, std::int32_t{2}, "snapshot: ... 2");
  expect_refused(worlds + 8, std::int32_t{-1}, "snapshot: ... 2");
  expect_refused(mode, std::uint8_t{3}, "snapshot: ... capture");
  expect_refused(settings, 200.0F, "camera.hfov_deg");
  expect_refused(settings + kSetting + 12, kInfinity, "camera.offset_m");
  for (const std::size_t length : {steps, ticks, worlds, settings, mode}) {
    EXPECT_REFUSED(batch.restore(blob.substr(0, length)), "snapshot");
    EXPECT_REFUSED(batch.restore(mended(blob.substr(0, length))), "snapshot");
    EXPECT_TRUE(batch.snapshot() == blob);
  }
  batch.restore(blob);
  EXPECT_EQ(shown(batch)[0], 1.0F);
}

}  // namespace
}  // namespace flockstep
