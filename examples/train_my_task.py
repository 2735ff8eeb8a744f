"""Your own task, trained with Stable-Baselines3 in about one minute: fly to a random point in an empty room.

Needs the extra [sb3]. python examples/train_my_task.py also writes a film of a flight, my_task.mp4.
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO

import flockstep
from flockstep.pictures.drawing import Drawing
from flockstep.task import Array, BoolArray

ROOM = flockstep.World.from_dict({"flockstep_scene": 1, "name": "empty", "room": {"min": [0, 0, 0], "max": [8, 8, 4]}})


class FlyToPoint(flockstep.Task):
    """Observe the offset to the target. The reward is progress in metres, plus 1 at the target and -1 on contact."""

    worlds = ROOM
    observation_space = spaces.Box(-8.0, 8.0, (3,), np.float32)
    max_episode_steps = 150

    def setup(self, batch: flockstep.Batch) -> None:
        self.target = np.zeros((batch.num_drones, 3))
        self.last_distance = np.zeros(batch.num_drones)

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        low, size = np.array([1, 1, 1]), np.array([6, 6, 2])
        batch.set_pose(low + size * batch.random(stream=0, count=3), None, mask)
        self.target[mask] = (low + size * batch.random(stream=1, count=3))[mask]
        self.last_distance[mask] = self.distance(batch)[mask]

    def step(self, batch: flockstep.Batch) -> tuple[Array, BoolArray]:
        distance = self.distance(batch)
        self.success[:] = distance < 0.3
        reward = self.last_distance - distance + self.success - batch.contact.hit
        self.last_distance = distance
        return reward, self.success | batch.contact.hit

    def observe(self, batch: flockstep.Batch) -> Array:
        return self.target - batch.position

    def draw(self, batch: flockstep.Batch, env: int, drawing: Drawing) -> None:
        drawing.spheres(self.target[env], 0.3, "green")

    def distance(self, batch: flockstep.Batch) -> Array:
        distance: Array = np.linalg.norm(self.target - batch.position, axis=1)
        return distance


def main(total_timesteps: int = 150_000, film: str | None = None) -> float:
    """Train, write a film if requested, then return the share of episodes that reached the target."""
    torch.set_num_threads(1)  # the network is small
    envs = flockstep.sb3.make_vec(FlyToPoint, num_envs=64, num_threads=1)
    model = PPO("MlpPolicy", envs, n_steps=128, batch_size=1024, learning_rate=1e-3, device="cpu", seed=0)
    model.learn(total_timesteps)
    if film:
        flockstep.record(film, model, FlyToPoint)
    rates = flockstep.success_rates(model, FlyToPoint, episodes=200, seed=1_000)  # new targets
    return rates[ROOM.name]


if __name__ == "__main__":
    print(f"reached the target in {main(film='my_task.mp4'):.0%} of the episodes")
