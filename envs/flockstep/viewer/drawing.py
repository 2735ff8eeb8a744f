"""What a task draws into the pictures of its envs."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from flockstep.viewer.depth_canvas import Color, Floats

COLORS: dict[str, Color] = {
    "black": (20, 20, 20),
    "grey": (128, 128, 128),
    "white": (255, 255, 255),
    "red": (214, 60, 50),
    "orange": (240, 140, 30),
    "yellow": (238, 190, 40),
    "green": (52, 160, 80),
    "blue": (35, 90, 210),
    "purple": (130, 40, 170),
}

_THIN_PX = 640


def line_px(width_px: int) -> int:
    """Return the unit of sizes in a picture of a width: a pixel up to 640 pixels, and more in wider ones."""
    return max(round(width_px / _THIN_PX), 1)


class Canvas(Protocol):
    """What can be drawn on, in metres of the world frame."""

    def dots(self, points: Floats, color: Color, *, size_px: int = 1) -> None:
        """Draw points (K, 3)."""

    def lines(self, starts: Floats, ends: Floats, color: Color, *, width_px: int = 1) -> None:
        """Draw lines between points (K, 3) and (K, 3)."""

    def sphere(self, center: Floats, radius_m: float, color: Color) -> None:
        """Draw a sphere."""


class Drawing:
    """Points, lines and spheres in the picture of one env: what `Task.draw` gets.

    Places are in metres of the world frame, one (3,) or several (K, 3); those that are not finite are left out. A
    colour is a name (``"black"``, ``"grey"``, ``"white"``, ``"red"``, ``"orange"``, ``"yellow"``, ``"green"``,
    ``"blue"``, ``"purple"``) or three integers from 0 to 255. Sizes and widths are in pixels of a picture 640 wide, and
    grow with wider ones. In a view with depth, what is nearer hides what is drawn; from above nothing hides it.
    """

    def __init__(self, canvas: Canvas, unit_px: int) -> None:
        self._canvas = canvas
        self._unit_px = unit_px

    def points(self, positions: npt.ArrayLike, color: str | tuple[int, int, int] = "orange", size: float = 6) -> None:
        """Draw points as squares."""
        places = _places("positions", positions)
        self._canvas.dots(places[_finite(places)], _color(color), size_px=self._px("size", size))

    def lines(
        self,
        starts: npt.ArrayLike,
        ends: npt.ArrayLike,
        color: str | tuple[int, int, int] = "orange",
        width: float = 2,
    ) -> None:
        """Draw straight lines from ``starts`` to ``ends``, either of which may be one for all.

        A path (K, 3) is ``lines(path[:-1], path[1:])``.
        """
        a, b = _places("starts", starts), _places("ends", ends)
        if len(a) != len(b) and 1 not in (len(a), len(b)):
            raise ValueError(f"ends: expected as many as starts ({len(a)}), or one for all, got {len(b)}")
        a, b = np.broadcast_arrays(a, b)
        both = _finite(a) & _finite(b)
        self._canvas.lines(a[both], b[both], _color(color), width_px=self._px("width", width))

    def spheres(self, centers: npt.ArrayLike, radius_m: float, color: str | tuple[int, int, int] = "orange") -> None:
        """Draw spheres of one radius. They are seen from outside only."""
        places = _places("centers", centers)
        radius, rgb = _positive("radius_m", radius_m), _color(color)
        for center in places[_finite(places)]:
            self._canvas.sphere(center, radius, rgb)

    def _px(self, field: str, size: float) -> int:
        return max(round(_positive(field, size) * self._unit_px), 1)


def _places(field: str, value: npt.ArrayLike) -> Floats:
    places = np.asarray(value, float)
    if places.ndim not in (1, 2) or places.shape[-1] != 3:
        raise ValueError(f"{field}: expected shape (3,) or (K, 3), got {places.shape}")
    return np.atleast_2d(places)


def _finite(places: Floats) -> npt.NDArray[np.bool_]:
    return np.asarray(np.isfinite(places).all(axis=1))


def _positive(field: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = np.nan
    if not 0 < number < np.inf:
        raise ValueError(f"{field}: expected a finite number above 0, got {value!r}")
    return number


def _color(color: Any) -> Color:
    if isinstance(color, str):
        if color not in COLORS:
            raise ValueError(f"color: expected one of {', '.join(COLORS)} or (red, green, blue), got {color!r}")
        return COLORS[color]
    rgb = np.asarray(color)
    if rgb.shape != (3,) or rgb.dtype.kind not in "iu" or rgb.min() < 0 or rgb.max() > 255:
        raise ValueError(f"color: expected a name or three integers from 0 to 255, got {color!r}")
    return int(rgb[0]), int(rgb[1]), int(rgb[2])
