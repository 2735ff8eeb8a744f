"""What a policy sees of an observation: features extractors for the built-in observations."""

from __future__ import annotations

import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

DIRECTION_SIZE = 3
DIRECTION_GAIN = 2.0
NEAREST = 0.05  # of the maximum range: keeps the logarithm finite, and flat where the hull would already touch

BLOB_SIZE = 2
OFFSET_GAIN = 3.0
WIDTH_GAIN = 5.0  # of the blob: its area's root is a hundredth or two across the playground, a half at the goal

COLOR_GAIN = 4.0


def nearness(ranges: torch.Tensor) -> torch.Tensor:
    """Return the negative logarithm of each range: what is near stands out."""
    return -torch.log(ranges + NEAREST)


class GoalFeatures(BaseFeaturesExtractor):
    """The direction to the goal, scaled, and how near the obstacles are."""

    def __init__(self, observation_space: spaces.Box) -> None:
        super().__init__(observation_space, features_dim=observation_space.shape[0])

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Turn observations (N, 3 + rays) into features of the same shape."""
        direction, ranges = observations[:, :DIRECTION_SIZE], observations[:, DIRECTION_SIZE:]
        return torch.cat([DIRECTION_GAIN * direction, nearness(ranges)], dim=1)


class BlobFeatures(BaseFeaturesExtractor):
    """Where the green is, how wide, whether it is seen at all, and how near the obstacles are."""

    def __init__(self, observation_space: spaces.Box) -> None:
        super().__init__(observation_space, features_dim=observation_space.shape[0] + 1)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Turn observations (N, 2 + rays) into features (N, 3 + rays)."""
        offset, area = observations[:, :1], observations[:, 1:BLOB_SIZE]
        blob = [OFFSET_GAIN * offset, WIDTH_GAIN * area.sqrt(), (area > 0).float()]
        return torch.cat([*blob, nearness(observations[:, BLOB_SIZE:])], dim=1)


class PixelFeatures(BaseFeaturesExtractor):
    """A small convolutional network over the image, and how near the obstacles are.

    The goal is a pixel or two wide for most of a flight, in a world of greys. So colours go in as eyes have them, as
    brightness and as differences, and these are amplified: one green pixel then outweighs the rest of the 4 x 4 that
    the first layer takes together.
    """

    def __init__(self, observation_space: spaces.Dict, channels: int = 16, hidden: int = 64) -> None:
        image, ranges = observation_space["image"], observation_space["ranges"]
        assert image.shape is not None
        assert ranges.shape is not None
        super().__init__(observation_space, features_dim=hidden + ranges.shape[0])
        self.image = nn.Sequential(
            nn.Conv2d(3, channels, 4, stride=4),
            nn.ReLU(),
            nn.Conv2d(channels, channels, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
        )
        with torch.no_grad():
            size = self.image(torch.zeros(1, *image.shape)).shape[1]
        self.hidden = nn.Sequential(nn.Linear(size, hidden), nn.ReLU())

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        """Turn images (N, 3, H, W) in [0, 1] and ranges (N, rays) into features (N, hidden + rays)."""
        red, green, blue = torch.split(observations["image"], 1, dim=1)
        opponents = torch.cat([green - 0.5, COLOR_GAIN * (green - red), COLOR_GAIN * (green - blue)], dim=1)
        seen = self.hidden(self.image(opponents))
        return torch.cat([seen, nearness(observations["ranges"])], dim=1)
