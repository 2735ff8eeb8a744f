"""A task with a depth camera: fly to the goal without contact.

docs/how-to/tasks/observe-images.md trains it, from a checkout:
.venv/bin/python -m training.train_ppo --task examples.depth_to_goal:DepthToGoal --generated 300 --frame-skip 4
"""

# ruff: noqa: D102 - the methods are those of flockstep.Task, documented there
import numpy as np
from gymnasium import spaces

import flockstep
from flockstep.task import Array, BoolArray


class DepthToGoal(flockstep.Task):
    """Observe the nearness of everything ahead and the direction to the goal; the reward is the progress in metres."""

    camera = flockstep.CameraConfig(width_px=64, height_px=48, outputs=("depth",))
    observation_space = spaces.Dict(
        nearness=spaces.Box(0, 1, (48, 64), np.float32), direction=spaces.Box(-1, 1, (3,), np.float32)
    )
    max_episode_steps = 400

    def setup(self, batch: flockstep.Batch) -> None:
        self.last_distance = np.zeros(batch.num_drones)

    def reset(self, batch: flockstep.Batch, mask: BoolArray) -> None:
        super().reset(batch, mask)  # to the start marker
        self.last_distance[mask] = batch.terms.goal_distance()[mask]

    def step(self, batch: flockstep.Batch) -> tuple[Array, BoolArray]:
        distance, crashed = batch.terms.goal_distance(), batch.contact.hit
        self.success[:] = (distance < 0.5) & ~crashed
        reward = self.last_distance - distance - 0.01 + 5.0 * self.success - 5.0 * crashed
        self.last_distance = distance
        return reward, self.success | crashed

    def observe(self, batch: flockstep.Batch) -> dict[str, Array]:
        nearness = 1 / (1 + batch.camera().depth)  # 1 at the lens, 0.5 at 1 m, 0 without a hit: depth is inf
        return {"nearness": nearness, "direction": batch.terms.goal_direction()}
