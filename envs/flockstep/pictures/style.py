"""The looks of pictures from behind drones and from fixed places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flockstep._core import World
from flockstep.pictures import choice
from flockstep.pictures.depth_canvas import Color
from flockstep.quadrotor_mesh import COLORS
from flockstep.relight import DARK_LIGHT

_DARKEST, _PALEST = 0.024, 0.26  # brightness of surfaces that were white and black
_TEXTURED = 0.16  # factor of white
_COOL = np.array([0.8, 1.0, 1.4])


@dataclass(frozen=True)
class Style:
    """Colours of what is drawn."""

    trail: Color
    beam: Color
    hit: Color
    frustum: Color
    beam_opacity: Sequence[float]
    """Of equal parts of a beam without a hit, from the drone on; the first is that of all other beams."""
    drone: Mapping[str, tuple[float, float, float]]
    """Of a quadrotor's parts, linear RGB."""
    is_dark: bool = False
    camera: Mapping[str, Any] = field(default_factory=dict)
    """Fields of cameras with samples and shadows."""

    def applied_to(self, world: World) -> World:
        """Return the world in the light and the colours of the style."""
        if not self.is_dark:
            return world
        tints = []
        for material in world.materials:
            color = np.asarray(material["base_color"], float)
            brightness = min(float(color @ [0.21, 0.72, 0.07]), 1.0)
            wanted = _DARKEST + (_PALEST - _DARKEST) * (1 - brightness) ** 2  # what is bright becomes dark
            # White is the base colour of textures and of meshes with colours of their own.
            factor = _TEXTURED if brightness > 0.99 else wanted / max(brightness, 0.02)
            tints.append(np.clip(factor * _COOL, 0, 10))
        return world.with_light(tint=np.array(tints, np.float32), **DARK_LIGHT)


_BRIGHT = Style((35, 90, 210), (250, 130, 70), (200, 50, 20), (130, 40, 170), (0.6,), COLORS)
_LOOKS = (
    _BRIGHT,
    Style(
        (70, 190, 255),
        (255, 120, 50),
        (255, 215, 120),
        (200, 120, 255),
        (0.7, 0.6, 0.52, 0.44, 0.36, 0.28, 0.2, 0.12),
        {"middle": (0.5, 0.52, 0.55), "arm": (0.22, 0.23, 0.25), "rear": (0.5, 0.55, 0.62)},
        is_dark=True,
    ),
    replace(_BRIGHT, camera={"sun_size_deg": 2.0, "ambient_occlusion_rays": 8}),
)
STYLES = dict(zip(choice.STYLES, _LOOKS, strict=True))
