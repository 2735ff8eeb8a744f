"""Copies of a world under different light, to make camera policies independent of the light."""

from __future__ import annotations

from typing import Any

import numpy as np

from flockstep._core import World
from flockstep.scenes import WorldLike, load_one

Range = tuple[float, float]

_NIGHT = (0.02, 0.026, 0.04)
#: Light of pictures in the dark style.
DARK_LIGHT: dict[str, Any] = {
    "sun_direction": (-0.35, -0.45, 1.0),
    "sun_color": (1.0, 0.97, 0.9),
    "sky_ambient": (0.55, 0.6, 0.7),
    "ground_ambient": (0.25, 0.27, 0.3),
    "zenith_color": _NIGHT,
    "horizon_color": _NIGHT,
}


def relight(
    world: WorldLike,
    count: int,
    seed: int = 0,
    *,
    azimuth_deg: Range = (0.0, 360.0),
    elevation_deg: Range = (15.0, 75.0),
    sun: Range = (0.5, 1.5),
    ambient: Range = (0.7, 1.2),
    tint: float = 0.15,
    fog_visibility_m: Range | None = None,
) -> list[World]:
    """Return copies of one world under random light; with ``random_world=True`` an environment draws one per episode.

    Each is made by `World.with_light`, so they share geometry and textures. World k depends only on the seed and k.

    Parameters
    ----------
    world
        A `World`, or the name or path of one.
    count
        Number of worlds, at least 1.
    seed
        Seed, at least 0.
    azimuth_deg, elevation_deg
        Ranges of the sun's direction: azimuth from +x towards +y, in [-360, 360], and elevation above the horizon, in
        [-90, 90].
    sun, ambient
        Ranges of the factors for the world's own sunlight and for its ambient light and sky; at least 0.
    tint
        Red, green and blue of each material are multiplied by random factors in [1 - tint, 1 + tint]; tint is in [0,
        1].
    fog_visibility_m
        Range of the visibility in fog, m, in [0.1, 1e6]. None: the world's own.
    """
    shape = load_one(world)
    for name, number, least in (("count", count, 1), ("seed", seed, 0)):
        if not isinstance(number, (int, np.integer)) or isinstance(number, bool) or number < least:
            raise ValueError(f"{name}: expected an integer >= {least}, got {number!r}")
    for name, span, low, high in (
        ("azimuth_deg", azimuth_deg, -360.0, 360.0),
        ("elevation_deg", elevation_deg, -90.0, 90.0),
        ("sun", sun, 0.0, 100.0),
        ("ambient", ambient, 0.0, 100.0),
        ("tint", (0.0, tint), 0.0, 1.0),
        ("fog_visibility_m", (1.0, 1.0) if fog_visibility_m is None else fog_visibility_m, 0.1, 1e6),
    ):
        pair = np.array(span, dtype=object).ravel()
        is_pair = len(pair) == 2 and all(isinstance(end, (int, float, np.number)) for end in pair)
        if not is_pair or not low <= pair[0] <= pair[1] <= high:
            one = name == "tint"
            expected = "a number" if one else "two numbers (low, high)"
            raise ValueError(f"{name}: expected {expected} in [{low:g}, {high:g}], got {tint if one else span!r}")
    usual = shape.light
    result = []
    for number in range(count):
        random = np.random.default_rng([seed, number])
        azimuth, elevation = np.radians([random.uniform(*azimuth_deg), random.uniform(*elevation_deg)])
        sunlight, daylight = random.uniform(*sun), random.uniform(*ambient)
        level = np.cos(elevation)

        def brighter(color: str, factor: float) -> tuple[float, float, float]:
            red, green, blue = np.minimum(100.0, np.multiply(usual[color], factor)).tolist()
            return red, green, blue

        result.append(
            shape.with_light(
                sun_direction=(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)),
                sun_color=brighter("sun_color", sunlight),
                sky_ambient=brighter("sky_ambient", daylight),
                ground_ambient=brighter("ground_ambient", daylight),
                zenith_color=brighter("zenith_color", daylight),
                horizon_color=brighter("horizon_color", daylight),
                tint=random.uniform(1.0 - tint, 1.0 + tint, (len(shape.materials), 3)),
                fog_visibility_m=None if fog_visibility_m is None else random.uniform(*fog_visibility_m),
            )
        )
    return result
