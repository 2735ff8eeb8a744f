// State: everything a batch knows about its drones, structure of arrays. N is the number of slots.
#pragma once

#include <cstdint>
#include <vector>

namespace flockstep {

using FlagArray = std::vector<std::uint8_t>;  // 0 or 1, viewed as bool

struct ContactState {           // written by collision, cleared by a reset or teleport
  FlagArray hit;                // (N,) something was touched
  FlagArray inside;             // (N,) the motion began in penetration
  std::vector<float> fraction;  // (N,) of the motion that was flown
  std::vector<float> point;     // (N, 3) m, world frame, on the obstacle
  std::vector<float> normal;    // (N, 3) unit, world frame, from the obstacle towards the drone
};

struct State {
  // hot: read and written every step
  std::vector<float> position;          // (N, 3) m, world frame; written by motion, collision, reset
  std::vector<float> quat_wxyz;         // (N, 4) unit, body to world; written by motion, collision, reset
  ContactState contact;                 // written by collision
  std::vector<float> lidar_ranges;      // (N, channels, beams) m, inf on a miss; written by sensors
  std::vector<float> sensed_position;   // (N, 3) m; written by sensors
  std::vector<float> sensed_quat_wxyz;  // (N, 4); written by sensors
  // cold
  FlagArray active;                       // (N,) 0: the slot is removed
  std::vector<std::int32_t> world_index;  // (N,) into the batch's worlds
  std::vector<std::uint64_t> seed;        // (N,) key of the env's random numbers
  std::vector<std::int64_t> episode;      // (N,) which episode of its seed, from 0
  std::vector<std::int64_t> scans;        // (N,) how often sensed in this episode: counter of the sensor noise
};

// The images of one camera, of all drones; what the camera does not write is empty. Row 0 is the top. Written by sensors.
struct CameraImages {
  std::vector<std::uint8_t> rgb;         // (N, H, W, 3) or (N, 3, H, W)
  std::vector<float> depth;              // (N, H, W) m; inf where nothing is seen: sky, or beyond far
  std::vector<std::uint16_t> semantic;   // (N, H, W) Material::semantic, kSemanticStart ...; 0 where nothing is seen
  std::vector<std::uint16_t> instance;   // (N, H, W) 1 + index into primitives(), then the meshes, then start, waypoints, goal;
                                         // 0 where nothing is seen
  std::vector<float> normal;             // (N, H, W, 3) or (N, 3, H, W) unit, world frame, towards the camera; 0 where nothing
  std::vector<std::uint8_t> grey;        // (N, H, W) 0.299 R + 0.587 G + 0.114 B of rgb (ITU-R BT.601), rounded
  std::vector<std::int64_t> frame_step;  // (N,) how often the drone had been sensed in its episode; -1: stale
};

// What a step or reset returns. Two of these rotate, so that what one returned stays intact during the next.
struct Outputs {
  std::vector<float> observation;            // (N, observation size)
  std::vector<float> final_observation;      // (N, observation size), valid where terminated or truncated
  std::vector<std::uint8_t> image;           // (N, 3, H, W), of a task that observes pixels
  std::vector<std::uint8_t> final_image;     // (N, 3, H, W) likewise, valid where terminated or truncated
  std::vector<float> reward;                 // (N,)
  std::vector<float> reward_terms;           // (N, kNumRewardTerms), weighted; their sum is the reward
  FlagArray terminated;                      // (N,)
  FlagArray truncated;                       // (N,)
  FlagArray success;                         // (N,) ended here at the final goal, without a crash
  FlagArray crashed;                         // (N,) ended here by a collision
  std::vector<double> episode_return;        // (N,) of the episode that ended here, else of the current one so far
  std::vector<std::int64_t> episode_length;  // (N,) likewise, in flown steps
};

}  // namespace flockstep
