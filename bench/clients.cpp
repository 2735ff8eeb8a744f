// Loads a server as chapter 5 of the thesis does, with clients at once, and prints their response times as a JSON list of
// figures. thesis/benchmarks.py starts the server and runs this program:
//
//   clients ADDRESS COUNT LOAD SECONDS    COUNT clients, each with a connection, a thread and a drone. LOAD: what each does again
//                                         and again: move, scan, image, or move+image, which moves before each image
//
// Only the last operation is timed. An image is a JPEG file of quality 90, the client's default.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <functional>
#include <latch>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench.hpp"
#include "flockstep/client.hpp"

namespace {

using namespace flockstep;
using Clock = std::chrono::steady_clock;

struct Response {
  double end_s;  // since the beginning of the load
  double ms;
};

struct Load {
  std::string address, kind;
  std::latch ready;
  std::atomic<bool> is_over{false};
};

// Loads the server by one drone until the time is over.
std::vector<Response> run(Load& load, std::int64_t index) {
  const client::Connection connection({.address = load.address, .timeout = std::chrono::minutes(1)});
  client::DroneController drone(connection, index);
  std::mt19937 random(static_cast<std::uint32_t>(index));
  std::uniform_real_distribution<float> displacement(-0.1F, 0.1F);
  client::Vector3 location = drone.get_location();
  const auto move = [&] {
    for (float& x : location) x += displacement(random);
    location = drone.set_location(location).location;
  };
  const std::function<void()> timed = load.kind == "move"   ? std::function<void()>(move)
                                      : load.kind == "scan" ? [&] { drone.get_lidar_data(); }
                                                            : std::function<void()>([&] { drone.get_camera_data(); });
  std::vector<Response> responses;
  load.ready.arrive_and_wait();
  const auto start = Clock::now();
  while (!load.is_over) {
    if (load.kind == "move+image") move();
    const double seconds = bench::seconds(timed);
    responses.push_back({std::chrono::duration<double>(Clock::now() - start).count(), 1e3 * seconds});
  }
  return responses;
}

// Adds the mean response time by time, as figures whose names end with the seconds since the beginning.
void add_curve(bench::Figures& figures, const std::vector<Response>& responses, double seconds) {
  constexpr std::size_t kPoints = 60;
  std::array<double, kPoints> sums{}, counts{};
  for (const Response& response : responses) {
    const auto point = std::min(static_cast<std::size_t>(response.end_s / seconds * kPoints), kPoints - 1);
    sums[point] += response.ms;
    ++counts[point];
  }
  for (std::size_t i = 0; i < kPoints; ++i) {
    const double at_s = (static_cast<double>(i) + 0.5) * seconds / kPoints;
    if (counts[i] > 0) figures.add("curve/" + std::to_string(at_s), sums[i] / counts[i], "ms", 1);
  }
}

void measure(const std::string& address, int count, const std::string& kind, double seconds) {
  constexpr std::array kKinds{"move", "scan", "image", "move+image"};
  if (std::ranges::find(kKinds, kind) == kKinds.end()) {
    throw std::invalid_argument("LOAD: expected move, scan, image or move+image, got \"" + kind + '"');
  }
  const auto begun = Clock::now();
  Load load{.address = address, .kind = kind, .ready = std::latch(count + 1)};
  std::vector<std::vector<Response>> each(static_cast<std::size_t>(count));
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < each.size(); ++i) {
    threads.emplace_back([&, i] { each[i] = run(load, static_cast<std::int64_t>(i)); });
  }
  load.ready.arrive_and_wait();
  const std::chrono::duration<double> connecting = Clock::now() - begun;
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  load.is_over = true;
  for (std::thread& thread : threads) thread.join();

  std::vector<Response> all;
  for (const std::vector<Response>& responses : each) all.insert(all.end(), responses.begin(), responses.end());
  std::ranges::sort(all, {}, &Response::ms);
  const auto requests = static_cast<double>(all.size());
  const auto sum = [&](const auto& of) { return std::transform_reduce(all.begin(), all.end(), 0.0, std::plus<>(), of); };
  const double mean = sum([](const Response& r) { return r.ms; }) / requests;
  const double variance = sum([mean](const Response& r) { return (r.ms - mean) * (r.ms - mean); }) / requests;
  const auto percentile = [&](int percent) {
    return all[static_cast<std::size_t>(std::round(percent / 100.0 * (requests - 1)))].ms;
  };
  bench::Figures figures;
  figures.add("connecting", connecting.count(), "s", 1);
  figures.add("requests", requests, "1", 1);
  figures.add("mean", mean, "ms", 1);
  figures.add("std", std::sqrt(variance), "ms", 1);
  figures.add("min", all.front().ms, "ms", 1);
  figures.add("max", all.back().ms, "ms", 1);
  for (const int percent : {5, 25, 75, 95}) figures.add('p' + std::to_string(percent), percentile(percent), "ms", 1);
  add_curve(figures, all, seconds);
  figures.print();
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 5) throw std::invalid_argument("expected ADDRESS COUNT LOAD SECONDS");
  measure(argv[1], std::stoi(argv[2]), argv[3], std::stod(argv[4]));
} catch (const std::exception& error) {
  std::fprintf(stderr, "clients: %s\n", error.what());
  return 1;
}
