"""Features extractors for the built-in observations and for any observation with images."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.preprocessing import get_flattened_obs_dim, is_image_space
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from flockstep.learning.networks import (
    BLOB_SIZE,
    DIRECTION_GAIN,
    DIRECTION_SIZE,
    NEAR_POINT_M,
    NEAREST,
    OFFSET_GAIN,
    WIDTH_GAIN,
)

COLOR_GAIN = 4.0

SMALLEST_IMAGE_PX = 8


def nearness(ranges: torch.Tensor) -> torch.Tensor:
    """Return the negative logarithm of each range, which emphasises near obstacles."""
    return -torch.log(ranges + NEAREST)


class GoalFeatures(BaseFeaturesExtractor):
    """The scaled direction to the goal, and the nearness of the obstacles."""

    def __init__(self, observation_space: spaces.Box) -> None:
        super().__init__(observation_space, features_dim=observation_space.shape[0])

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Convert observations (N, 3 + rays) into features of the same shape."""
        direction, ranges = observations[:, :DIRECTION_SIZE], observations[:, DIRECTION_SIZE:]
        return torch.cat([DIRECTION_GAIN * direction, nearness(ranges)], dim=1)


class NormalizedFeatures(BaseFeaturesExtractor):
    """Observations shifted and scaled by constants and clipped to +-10, as `flockstep.PPO` does.

    Parameters
    ----------
    observation_space
        A Box, or a Dict of Boxes, which is flattened in the order of its names.
    mean, variance
        Of each number of an observation.
    inner
        Features extractor of the results. None: the results themselves.
    count
        Number of observations behind the mean and the variance, which `flockstep.PPO.from_sb3` reads.
    """

    def __init__(
        self,
        observation_space: spaces.Box | spaces.Dict,
        mean: list[float],
        variance: list[float],
        inner: type[BaseFeaturesExtractor] | None = None,
        count: float = 1.0,
    ) -> None:
        flat = spaces.Box(-np.inf, np.inf, (len(mean),), np.float32)
        extractor = nn.Identity() if inner is None else inner(flat)
        super().__init__(observation_space, features_dim=int(getattr(extractor, "features_dim", len(mean))))
        self.inner, self.count = extractor, count
        self.mean: torch.Tensor
        self.variance: torch.Tensor
        self.register_buffer("mean", torch.as_tensor(mean, dtype=torch.float64))
        self.register_buffer("variance", torch.as_tensor(variance, dtype=torch.float64))

    def forward(self, observations: torch.Tensor | dict[str, torch.Tensor]) -> torch.Tensor:
        """Convert observations (N, ...), or a dict of them, into features (N, features_dim)."""
        parts = list(observations.values()) if isinstance(observations, dict) else [observations]
        flat = torch.cat([part.flatten(1) for part in parts], dim=1).double()
        normal = ((flat - self.mean) / torch.sqrt(self.variance + 1e-8)).float().clamp(-10, 10)
        return self.inner(normal)  # type: ignore[no-any-return]


class BlobFeatures(BaseFeaturesExtractor):
    """Offset and width of the green blob, a flag for its presence, and the nearness of the obstacles."""

    def __init__(self, observation_space: spaces.Box) -> None:
        super().__init__(observation_space, features_dim=observation_space.shape[0] + 1)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Convert observations (N, 2 + rays) into features (N, 3 + rays)."""
        offset, area = observations[:, :1], observations[:, 1:BLOB_SIZE]
        blob = [OFFSET_GAIN * offset, WIDTH_GAIN * area.sqrt(), (area > 0).float()]
        return torch.cat([*blob, nearness(observations[:, BLOB_SIZE:])], dim=1)


class PointFeatures(BaseFeaturesExtractor):
    """For Hover and Track: the observation, preceded by the offset to the target point with small distances amplified.

    The offset is divided by its own length plus 10 cm: far away it is a direction, near the point ten times the offset.
    """

    def __init__(self, observation_space: spaces.Box) -> None:
        super().__init__(observation_space, features_dim=observation_space.shape[0] + DIRECTION_SIZE)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Convert observations (N, k) into features (N, 3 + k)."""
        way = observations[:, :DIRECTION_SIZE]
        return torch.cat([way / (way.norm(dim=1, keepdim=True) + NEAR_POINT_M), observations], dim=1)


class PixelFeatures(BaseFeaturesExtractor):
    """A small convolutional network over the image, and the nearness of the obstacles.

    For most of a flight the goal is one or two pixels wide in a grey world. Colours are therefore fed in as brightness
    and amplified colour differences, as in human vision. One green pixel then outweighs the rest of its 4 x 4 block in
    the first layer.
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
        """Convert images (N, 3, H, W) in [0, 1] and ranges (N, rays) into features (N, hidden + rays)."""
        red, green, blue = torch.split(observations["image"], 1, dim=1)
        opponents = torch.cat([green - 0.5, COLOR_GAIN * (green - red), COLOR_GAIN * (green - blue)], dim=1)
        seen = self.hidden(self.image(opponents))
        return torch.cat([seen, nearness(observations["ranges"])], dim=1)


def is_image(space: spaces.Space[Any]) -> bool:
    """Return whether `ImageFeatures` treats a space as an image: a Box (H, W), (channels, H, W) or (H, W, channels).

    Height and width are at least 8 pixels, and there are fewer channels than either.
    """
    if not isinstance(space, spaces.Box) or len(space.shape) not in (2, 3):
        return False
    *channels, short, _ = sorted(space.shape)
    return short >= SMALLEST_IMAGE_PX and all(count in (space.shape[0], space.shape[-1]) for count in channels)


class ImageFeatures(BaseFeaturesExtractor):
    """A small convolutional network over each image of an observation; the rest of the observation is passed through.

    Images may be colours, depth or masks. Each network has a 4 x 4 layer with stride 4, a 3 x 3 layer with stride 2 and
    twice the channels, and a hidden layer. Its inputs are in [0, 1]: Stable-Baselines3 divides uint8 colours by 255,
    and this class scales all other images by the bounds of their space.

    Parameters
    ----------
    observation_space
        A Box, or a Dict of Boxes. At least one must be an image of 8 x 8 pixels or more, with shape (H, W), (channels,
        H, W) or (H, W, channels) and finite bounds.
    channels
        Channels of the first layer.
    hidden
        Number of features per image.

    Raises
    ------
    ValueError
        There is no image, or an image has infinite bounds.
    """

    def __init__(self, observation_space: spaces.Box | spaces.Dict, channels: int = 8, hidden: int = 64) -> None:
        parts = _parts(observation_space)
        images = [name for name, part in parts.items() if is_image(part)]
        if not images:
            raise ValueError(f"ImageFeatures: expected an image of at least 8 x 8 pixels, got {observation_space}")
        sizes = [hidden if name in images else get_flattened_obs_dim(part) for name, part in parts.items()]
        super().__init__(observation_space, features_dim=sum(sizes))
        self.names = list(parts)
        self.nets = nn.ModuleList(
            _image_net(name, part, channels, hidden) if name in images else nn.Flatten() for name, part in parts.items()
        )

    def forward(self, observations: torch.Tensor | dict[str, torch.Tensor]) -> torch.Tensor:
        """Convert observations (N, ...), or a dict of them, into features (N, features_dim) in the Dict's order."""
        seen = observations if isinstance(observations, dict) else {_ONLY: observations}
        return torch.cat([net(seen[name]) for name, net in zip(self.names, self.nets, strict=True)], dim=1)


_ONLY = "observation"


def _parts(space: spaces.Box | spaces.Dict) -> dict[str, spaces.Space[Any]]:
    return dict(space.spaces) if isinstance(space, spaces.Dict) else {_ONLY: space}


def _image_net(name: str, space: spaces.Space[Any], channels: int, hidden: int) -> nn.Sequential:
    assert isinstance(space, spaces.Box)
    planes = _Planes(name, space)
    convolutions = nn.Sequential(
        planes,
        nn.Conv2d(planes.count, channels, 4, stride=4),
        nn.ReLU(),
        nn.Conv2d(channels, 2 * channels, 3, stride=2, padding=1),
        nn.ReLU(),
        nn.Flatten(),
    )
    with torch.no_grad():
        size = convolutions(torch.zeros(1, *space.shape)).shape[1]
    return nn.Sequential(convolutions, nn.Linear(size, hidden), nn.ReLU())


class _Planes(nn.Module):
    """Images as (N, channels, H, W) in [0, 1]."""

    def __init__(self, name: str, space: spaces.Box) -> None:
        super().__init__()
        low, high = float(space.low.min()), float(space.high.max())
        if not (np.isfinite([low, high]).all() and low < high):
            raise ValueError(f"ImageFeatures: {name}: expected an image of finite bounds, got [{low:g}, {high:g}]")
        self.low, self.high = (0.0, 1.0) if is_image_space(space) else (low, high)  # the former are already scaled
        self.flat = len(space.shape) == 2
        self.channels_last = not self.flat and space.shape[-1] == min(space.shape)
        self.count = 1 if self.flat else min(space.shape)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        planes = images.unsqueeze(1) if self.flat else images.permute(0, 3, 1, 2) if self.channels_last else images
        return (planes - self.low) / (self.high - self.low)
