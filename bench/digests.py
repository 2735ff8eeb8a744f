"""Prints digests of the built-in tasks' results: two commits with the same output behave the same, bit by bit.

For each environment and autoreset mode it flies 2,000 steps under random actions. Every observation (including final
ones), reward, reward term, flag, position and IMU reading goes into a SHA-256. The stored policies fly Hover and Track
for 300 steps; their actions and rewards go into another digest. Digests are comparable only on one machine, because
mathematical libraries differ.

Run python bench/digests.py > before.txt, and again after a change; then compare the two files.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from typing import Any

import gymnasium as gym
import numpy as np

import flockstep

ENVS = {
    "LidarNavigation-v0": {"worlds": "train"},
    "LidarNavigation-v0 (random starts and worlds, staggered)": {
        "worlds": "train",
        "random_start": True,
        "random_world": True,
        "stagger_first_episode": True,
        "max_episode_steps": 120,
    },
    "LidarNavigation-v0 (displacement and yaw)": {"worlds": "validation", "action": "displacement_yaw"},
    "CameraNavigation-v0": {"max_episode_steps": 150},
    "CameraPixels-v0": {"max_episode_steps": 150, "frame_skip": 3},
    "Hover-v0": {"max_episode_steps": 120},
    "Hover-v0 (stop, Dryden gusts, IMU at 250 Hz)": {
        "on_contact": "stop",
        "wind": flockstep.WindConfig(gusts="dryden", mean_mps=(4, 1, 0)),
        "imu": flockstep.ImuConfig(accelerometer_noise_density=0.02, gyroscope_random_walk=0.01, rate_hz=250),
        "policy_hz": 50,
        "physics_hz": 500,
        "max_episode_steps": 200,
    },
    "Hover-v0 (bounce, ground effect)": {"on_contact": "bounce", "ground_effect": True, "max_episode_steps": 200},
    "Track-v0 (gusts, IMU)": {
        "wind": flockstep.WindConfig(gusts="ornstein_uhlenbeck", gust_std_mps=3),
        "imu": flockstep.ImuConfig(gyroscope_noise_density=0.01, accelerometer_random_walk=0.02),
        "max_episode_steps": 200,
    },
    "Race-v0 (generated tracks)": {"worlds": "race_track/seed-0..3", "laps": 1, "max_episode_steps": 120},
}
POLICIES = {"flockstep/Hover-v0": "hover", "flockstep/Track-v0": "track"}
MODES = ("next_step", "same_step", "disabled")
STEPS = 2000


def update(digest: Any, value: Any) -> None:
    """Add an array, or a dict or an object array of arrays, to a digest."""
    if isinstance(value, dict):
        for key in sorted(value):
            digest.update(key.encode())
            update(digest, value[key])
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for item in value:
            if item is not None:
                update(digest, item)
    else:
        digest.update(np.ascontiguousarray(value).tobytes())


def digest_of(name: str, keywords: dict[str, Any], mode: str, num_envs: int, steps: int) -> str:
    envs = gym.make_vec(f"flockstep/{name.split()[0]}", num_envs=num_envs, autoreset_mode=mode, **keywords)
    digest = hashlib.sha256()
    rng = np.random.default_rng(7)
    update(digest, envs.reset(seed=11)[0])
    batch = envs.unwrapped.batch
    space = envs.single_action_space
    done = np.zeros(num_envs, bool)
    for _ in range(steps):
        if mode == "disabled" and done.any():
            update(digest, envs.reset(options={"reset_mask": done})[0])
        if isinstance(space, gym.spaces.Discrete):
            # Move forward more often than not, so that episodes make progress.
            actions = np.where(rng.random(num_envs) < 0.4, 0, rng.integers(0, space.n, num_envs))
        else:
            actions = rng.uniform(-1.2, 1.2, (num_envs, *space.shape)).astype(np.float32)
        observation, reward, terminated, truncated, infos = envs.step(actions)
        done = terminated | truncated
        for value in (observation, reward, terminated, truncated, infos, batch.reward_terms, batch.position):
            update(digest, value)
        if "imu" in keywords:
            update(digest, batch.accelerometer)
            update(digest, batch.gyroscope)
    envs.close()
    return digest.hexdigest()


def policy_digest(env_id: str, name: str, num_envs: int) -> str:
    """Return the digest of a stored policy's actions and rewards."""
    model = flockstep.policies.load(name)
    envs = gym.make_vec(env_id, num_envs=num_envs)
    digest = hashlib.sha256()
    observation, _ = envs.reset(seed=11)
    for _ in range(300):
        actions, _ = model.predict(observation, deterministic=True)
        observation, reward, *_ = envs.step(actions)
        update(digest, actions)
        update(digest, reward)
    envs.close()
    return digest.hexdigest()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--num-envs", type=int, default=24)
    parser.add_argument("--steps", type=int, default=STEPS)
    arguments = parser.parse_args()
    for name, keywords in ENVS.items():
        for mode in MODES:
            print(f"{digest_of(name, keywords, mode, arguments.num_envs, arguments.steps)}  {name}, {mode}")
            sys.stdout.flush()
    for env_id, name in POLICIES.items():
        print(f"{policy_digest(env_id, name, arguments.num_envs)}  policies/{name}, {env_id}")
    print(f"simd {flockstep._core.simd_target}")


if __name__ == "__main__":
    main()
