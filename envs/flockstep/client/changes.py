"""The keywords of a client that change configurations; made by bindings/stubs.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from flockstep._core import RangeErrors


class LidarChanges(TypedDict, total=False):
    """Fields of `LidarConfig` that change.

    Parameters
    ----------
    max_range_m
        Maximum range. Beyond it is a miss: inf in metres, 1 when normalised. Values: > 0 m.
    hfov_deg
        Horizontal field of view. Values: (0, 360] deg.
    vfov_deg
        Vertical field of view. Values: [0, 180] deg.
    offset_m
        Position (x, y, z) in the body frame. Values: within +-100 m.
    quat_wxyz
        Rotation (w, x, y, z) from sensor to body. A norm near 1 is normalised. Values: a unit quaternion.
    errors
        How ranges err.
    beams
        Beams of a channel, counter-clockwise from -hfov/2 to +hfov/2, both included (at 360 without the end). At
        most 262144 in all channels. Values: [1, 262144].
    channels
        Channels, from -vfov/2 to +vfov/2 around the middle, both included. A single one lies there. Values: [1,
        262144].
    """

    max_range_m: float | None
    hfov_deg: float | None
    vfov_deg: float | None
    offset_m: Sequence[float] | None
    quat_wxyz: Sequence[float] | None
    errors: RangeErrors | None
    beams: int | None
    channels: int | None


class CameraChanges(TypedDict, total=False):
    """Fields of `CameraConfig` that change.

    Parameters
    ----------
    hfov_deg
        Horizontal field of view. With only one of the two, pixels are square. With neither, this one is 90. Values:
        [0.1, 179] deg.
    vfov_deg
        Vertical field of view. Values: [0.1, 179] deg.
    offset_m
        Position (x, y, z) in the body frame. Values: within +-100 m.
    quat_wxyz
        Rotation (w, x, y, z) from sensor to body. A norm near 1 is normalised. Values: a unit quaternion.
    width_px
        Width of the rendered image. Values: [1, 8192] px.
    height_px
        Height of the rendered image. Values: [1, 8192] px.
    """

    hfov_deg: float | None
    vfov_deg: float | None
    offset_m: Sequence[float] | None
    quat_wxyz: Sequence[float] | None
    width_px: int | None
    height_px: int | None


class LightChanges(TypedDict, total=False):
    """Fields of `Light` that change.

    Parameters
    ----------
    sun_direction
        Direction towards the sun, of any length. Values: within +-1e+06, not all 0.
    sun_color
        Linear RGB of the sun's light. Values: [0, 100].
    sky_ambient
        Linear RGB of the light from above. Values: [0, 100].
    ground_ambient
        Linear RGB of the light from below. Values: [0, 100].
    zenith_color
        Linear RGB of the sky straight up. Values: [0, 100].
    horizon_color
        Linear RGB of the sky at the horizon and below. Values: [0, 100].
    gamma
        A value v is written as 255 * min(v, 1)^(1 / gamma). Values: [1, 4].
    sun_radius_deg
        Radius of the sun's disc. 0: no disc. The real sun's is 0.27. Values: 0 or [0.1, 45] deg.
    sun_glow
        Share of the sun's colour in the sky next to it. It falls to half at 5.7 degrees. Values: [0, 1].
    fog_visibility_m
        Distance at which fog leaves 2 % of a surface's contrast to the sky. 0: no fog. Values: 0 or [0.1, 1000000]
        m.
    """

    sun_direction: Sequence[float] | None
    sun_color: Sequence[float] | None
    sky_ambient: Sequence[float] | None
    ground_ambient: Sequence[float] | None
    zenith_color: Sequence[float] | None
    horizon_color: Sequence[float] | None
    gamma: float | None
    sun_radius_deg: float | None
    sun_glow: float | None
    fog_visibility_m: float | None
