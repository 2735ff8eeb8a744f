"""What the policy sees of a LiDAR observation."""

from __future__ import annotations

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

DIRECTION_SIZE = 3
DIRECTION_GAIN = 2.0
NEAREST = 0.05  # of the maximum range: keeps the logarithm finite, and flat where the hull would already touch


class LogRangeFeatures(BaseFeaturesExtractor):
    """The direction to the goal, scaled, and the negative logarithm of each range: what is near stands out."""

    def __init__(self, observation_space: spaces.Box) -> None:
        super().__init__(observation_space, features_dim=observation_space.shape[0])

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Turn observations (N, 3 + rays) into features of the same shape."""
        direction, ranges = observations[:, :DIRECTION_SIZE], observations[:, DIRECTION_SIZE:]
        return torch.cat([DIRECTION_GAIN * direction, -torch.log(ranges + NEAREST)], dim=1)
