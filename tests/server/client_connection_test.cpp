// The ways to the server, its streams, and the task over it.
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <unistd.h>

#include <cstdio>

#include "server/served.hpp"

namespace flockstep {
namespace {

using namespace serving;

constexpr std::array<const char*, 1> kPosition{"position"};

TEST(Client, StepsInLockstep) {
  Served served(rotors());
  GameModeController first(served.connect()), second(served.connect());
  first.join_lockstep();
  second.join_lockstep();
  auto step = first.step(later);
  EXPECT_FALSE(step.get_for(20ms));
  EXPECT_EQ(second.step().step, 1);
  EXPECT_EQ(step.get().step, 1);
  step = first.step(later);
  second.leave_lockstep();
  EXPECT_EQ(step.get().step, 2);
}

TEST(Client, Streams) {
  Served served(kinematic());
  const Connection connection = served.connect();
  GameModeController simulation(connection);
  DroneController drone(connection, 0);
  const std::vector<std::string> names(kPosition.begin(), kPosition.end());
  auto arrays = simulation.stream_arrays(200, names, {}, true);
  ASSERT_TRUE(arrays.next(5s));
  EXPECT_FALSE(arrays.next(30ms));  // nothing has changed
  drone.set_location({0, 1, 1}, true);
  const auto changed = arrays.next(5s);
  ASSERT_TRUE(changed);
  EXPECT_EQ(changed->values<float>("position")[1], 1.0F);
  auto scans = drone.stream_lidar(500);
  auto pictures = drone.stream_camera(100, {.format = client::ImageFormat::png});
  auto speeds = simulation.stream_fps(100);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(scans.next(5s).value().ranges.size(), 35U);
    EXPECT_EQ(pictures.next(5s).value().width_px, 32);
    EXPECT_TRUE(speeds.next(5s));
    EXPECT_EQ(drone.get_location(), (Vector3{0, 1, 1}));
  }
  {
    auto ended = std::move(scans);
  }
  EXPECT_EQ(error_of([&] { drone.stream_lidar(-1).next(5s); }).code(), ErrorCode::invalid_argument);
  drone.ping();
}

TEST(Client, StepsTheTask) {
  NavigationBatch config = navigation_batch(3);
  config.navigation.action = ActionKind::displacement;
  Batch batch = config.make({room()}), twin = config.make({room()});
  Server server(batch, {.port = 0});
  const Connection connection({.address = server.address()});
  GameModeController simulation(connection);
  EXPECT_TRUE(connection.server().has_task);
  const client::Task task = simulation.get_task();
  const TaskSpec& spec = twin.task()->spec();
  EXPECT_EQ(task.num_rows, 3);
  EXPECT_EQ(task.reward_terms, spec.reward_terms);
  EXPECT_EQ(task.action.shape, std::vector<std::size_t>{3});
  ASSERT_EQ(task.observation.size(), spec.observation.size());
  EXPECT_EQ(task.observation[0].name, spec.observation[0].name);
  EXPECT_EQ(error_of([&] { simulation.step_envs(client::Array::of<float>({3, 3}, std::vector<float>(9))); }).code(),
            ErrorCode::failed_precondition);

  const std::vector<std::uint64_t> seeds{5, 6, 7};
  const client::Readings begin = simulation.reset_envs({.seeds = seeds});
  twin.reset(seeds);
  const auto check = [&](const client::Readings& readings) {
    for (std::size_t i = 0; i < spec.observation.size(); ++i) {
      const client::Array& array = readings.array("observation/" + spec.observation[i].name);
      EXPECT_TRUE(same_bits(array.bytes, twin.outputs().observation[i].bytes())) << spec.observation[i].name;
    }
  };
  check(begin);
  for (int i = 0; i < 40; ++i) {
    const std::vector<float> actions(9, i % 2 == 0 ? 1.0F : 0.5F);
    const client::Readings step = simulation.step_envs(client::Array::of({3, 3}, actions));
    twin.step(actions);
    check(step);
    EXPECT_TRUE(same_bits(step.values<float>("reward"), twin.outputs().reward));
    EXPECT_TRUE(same_bits(step.values<bool>("terminated"), twin.outputs().terminated));
  }
  const client::Readings again = simulation.reset_envs({.mask = std::vector<std::uint8_t>{0, 1, 0}});
  twin.reset({}, EnvMask(std::vector<std::uint8_t>{0, 1, 0}));
  check(again);
}

TEST(Client, StepsDronesWhoseEpisodesEndSeparately) {
  for (const Episodes episodes : {Episodes::each, Episodes::last}) {
    NavigationBatch config = navigation_batch(2);
    config.drones_per_env = 3;
    config.episode.episodes = episodes;
    config.episode.autoreset_mode = AutoresetMode::disabled;
    config.episode.max_episode_steps = 40;
    Batch batch = config.make({room()}), twin = config.make({room()});
    Server server(batch, {.port = 0});
    const Connection connection({.address = server.address()});
    GameModeController simulation(connection);
    EXPECT_EQ(simulation.get_task().episodes, episodes == Episodes::each ? "each" : "last");
    const std::string observation = "observation/" + twin.task()->spec().observation[0].name;
    const std::vector<std::uint64_t> seeds{5, 6};
    simulation.reset_envs({.seeds = seeds});
    twin.reset(seeds);
    int waited = 0;
    for (std::int64_t i = 0; i < 100; ++i) {
      std::vector<std::int64_t> actions(6);
      for (std::size_t drone = 0; drone < 6; ++drone) actions[drone] = drone % 3 == 0 ? 0 : i % 2;  // one of three flies ahead
      const client::Readings step = simulation.step_envs(client::Array::of({6}, actions));
      twin.step(actions);
      EXPECT_TRUE(same_bits(step.values<bool>("terminated"), twin.outputs().terminated));
      EXPECT_TRUE(same_bits(step.values<bool>("waiting"), twin.waiting()));
      std::vector<std::uint8_t> ended(6);
      for (std::size_t drone = 0; drone < 6; ++drone) {
        ended[drone] = twin.outputs().terminated[drone] | twin.outputs().truncated[drone];
      }
      if (std::ranges::count(ended, 1) == 0) continue;
      const client::Readings reset = simulation.reset_envs({.mask = ended});
      twin.reset_drones(DroneMask(ended));
      EXPECT_TRUE(same_bits(reset.values<bool>("waiting"), twin.waiting()));
      EXPECT_TRUE(same_bits(reset.array(observation).bytes, twin.outputs().observation[0].bytes()));
      waited += static_cast<int>(std::ranges::count(twin.waiting(), 1));
    }
    EXPECT_EQ(waited > 0, episodes == Episodes::last);
    const std::vector<std::uint8_t> five(5, 1);
    EXPECT_EQ(error_of([&] { simulation.reset_envs({.mask = five}); }).code(), ErrorCode::invalid_argument);
    const client::Error refused =
        error_of([&] { simulation.reset_envs({.seeds = seeds, .mask = std::vector<std::uint8_t>(6, 1)}); });
    EXPECT_EQ(refused.code(), ErrorCode::invalid_argument) << refused.what();
  }
}

// -------------------------------------------------------------------------------------------------------- ways to the server

TEST(Client, ConnectsByAUnixSocket) {
  const std::string path = "/tmp/flockstep-client-test-" + std::to_string(getpid());
  {
    Served served(kinematic(), {.address = "unix:" + path});
    const Connection connection({.address = "unix:" + path});
    EXPECT_EQ(DroneController(connection, 0).get_location(), (Vector3{-1, 0, 1}));
  }
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(Client, NeedsTheToken) {
  const Served served(kinematic(), {.token = "secret"});
  GameModeController(served.connect("secret")).ping();
  for (const char* const token : {"", "secre", "secrets", "Secret"}) {
    const client::Error refused = error_of([&] { served.connect(token); });
    EXPECT_EQ(refused.code(), ErrorCode::unauthenticated) << refused.what();
  }
}

TEST(Client, HearsThatTheServerStops) {
  Served served(kinematic());
  const Connection connection = served.connect();
  DroneController drone(connection, 0);
  drone.ping();
  served.server.stop();
  const client::Error error = error_of([&] {
    for (;;) drone.ping();
  });
  EXPECT_EQ(error.code(), ErrorCode::unavailable);
  EXPECT_TRUE(names(std::string(error.what()), "the server stops"));
  EXPECT_FALSE(connection.is_open());
}

// Writes a self-signed certificate for localhost and its key, and removes the files in the end.
class Certificate {
 public:
  Certificate() : folder_(std::filesystem::temp_directory_path() / ("flockstep-tls-" + std::to_string(getpid()))) {
    std::filesystem::create_directories(folder_);
    const std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)> key(EVP_EC_gen("P-256"), EVP_PKEY_free);
    const std::unique_ptr<X509, decltype(&X509_free)> x509(X509_new(), X509_free);
    X509_set_version(x509.get(), 2);
    ASN1_INTEGER_set(X509_get_serialNumber(x509.get()), 1);
    X509_gmtime_adj(X509_getm_notBefore(x509.get()), -3600);
    X509_gmtime_adj(X509_getm_notAfter(x509.get()), 86400);
    X509_set_pubkey(x509.get(), key.get());
    X509_NAME* const name = X509_get_subject_name(x509.get());
    X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char*>("flockstep"), -1, -1, 0);
    X509_set_issuer_name(x509.get(), name);
    X509_EXTENSION* const names = X509V3_EXT_conf_nid(nullptr, nullptr, NID_subject_alt_name, "DNS:drones.example,IP:127.0.0.1");
    X509_add_ext(x509.get(), names, -1);
    X509_EXTENSION_free(names);
    X509_sign(x509.get(), key.get(), EVP_sha256());
    std::FILE* file = std::fopen(certificate().c_str(), "w");
    PEM_write_X509(file, x509.get());
    std::fclose(file);
    file = std::fopen(private_key().c_str(), "w");
    PEM_write_PrivateKey(file, key.get(), nullptr, nullptr, 0, nullptr, nullptr);
    std::fclose(file);
  }
  ~Certificate() { std::filesystem::remove_all(folder_); }
  Certificate(const Certificate&) = delete;
  Certificate& operator=(const Certificate&) = delete;

  std::string certificate() const { return folder_ / "certificate.pem"; }
  std::string private_key() const { return folder_ / "key.pem"; }

 private:
  std::filesystem::path folder_;
};

TEST(Client, ConnectsByTls) {
  const Certificate files;
  Served served(kinematic(), {.certificate_file = files.certificate(), .private_key_file = files.private_key()});
  const client::Options options{.address = served.server.address(), .timeout = 5s, .tls = true, .ca_file = files.certificate()};
  const Connection connection(options);
  GameModeController simulation(connection);
  const std::vector<std::uint8_t> snapshot = simulation.snapshot();
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(DroneController(connection, 0).get_lidar_data().ranges.size(), 35U);
    simulation.restore(snapshot);
  }
  auto stream = simulation.stream_fps(100);
  EXPECT_TRUE(stream.next(5s));

  client::Options named = options;
  named.host_name = "drones.example";
  GameModeController(Connection(named)).ping();
  named.host_name = "other.example";
  const client::Error other = error_of([&] { Connection refused(named); });
  EXPECT_EQ(other.code(), ErrorCode::unavailable);
  EXPECT_TRUE(names(std::string(other.what()), "ostname mismatch"));

  client::Options untrusting = options;
  untrusting.ca_file.clear();
  const client::Error refused = error_of([&] { Connection none(untrusting); });
  EXPECT_TRUE(names(std::string(refused.what()), "is not trusted"));

  const client::Error plain = error_of([&] { Connection none({.address = served.server.address()}); });
  EXPECT_TRUE(names(std::string(plain.what()), "set Options::tls"));
}

}  // namespace
}  // namespace flockstep
