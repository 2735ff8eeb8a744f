"""Prints digests of what the built-in tasks return: two commits that print the same behave the same, to the last bit.

For each environment and autoreset mode: 2,000 steps under random actions, without sensor noise; every observation
(final ones included), reward, reward term and flag goes into a SHA-256. Digests hold on one machine: mathematical
libraries differ.

python bench/digests.py > before.txt, and again after a change; then compare the two.
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
}
MODES = ("next_step", "same_step", "disabled")
STEPS = 2000


def update(digest: Any, value: Any) -> None:
    """Add an array, or a dict or an object array of them, to a digest."""
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
    space = envs.single_action_space
    done = np.zeros(num_envs, bool)
    for _ in range(steps):
        if mode == "disabled" and done.any():
            update(digest, envs.reset(options={"reset_mask": done})[0])
        if isinstance(space, gym.spaces.Discrete):
            # Ahead more often than not, so that episodes get somewhere.
            actions = np.where(rng.random(num_envs) < 0.4, 0, rng.integers(0, space.n, num_envs))
        else:
            actions = rng.uniform(-1.2, 1.2, (num_envs, *space.shape)).astype(np.float32)
        observation, reward, terminated, truncated, infos = envs.step(actions)
        done = terminated | truncated
        for value in (observation, reward, terminated, truncated, infos, envs.unwrapped.batch.reward_terms):
            update(digest, value)
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
    print(f"simd {flockstep._core.simd_target}")


if __name__ == "__main__":
    main()
