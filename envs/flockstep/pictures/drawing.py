"""The drawing interface for tasks."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from flockstep.errors import did_you_mean, refuse_masked
from flockstep.pictures.depth_canvas import Color, Floats, Image

if TYPE_CHECKING:
    from flockstep._core import Batch

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
_HALO = 1 / 8  # width of the edge of a text, as a fraction of its size


def line_px(width_px: int) -> int:
    """Return the size unit for a picture width: one pixel up to 640 pixels, more in wider pictures."""
    return max(round(width_px / _THIN_PX), 1)


class Canvas(Protocol):
    """A surface to draw on, in metres of the world frame."""

    def dots(self, points: Floats, color: Color, *, size_px: int = 1) -> None:
        """Draw points (K, 3)."""

    def lines(self, starts: Floats, ends: Floats, color: Color, *, width_px: int = 1) -> None:
        """Draw lines between points (K, 3) and (K, 3)."""

    def sphere(self, center: Floats, radius_m: float, color: Color) -> None:
        """Draw a sphere."""

    def cells(self, centers: Floats, size_m: float, colors: Image) -> None:
        """Tint level squares around points (K, 3), each in a colour (K, 3)."""

    def stamp(self, place: Floats, picture: Image) -> None:
        """Put a picture (h, w, 4), whose last channel is its opacity, with its middle at a position (3,)."""


class Drawing:
    """Points, lines, spheres, cells and text in the picture of one env: the last argument of `Task.draw`.

    Positions are in metres of the world frame, one (3,) or several (K, 3); those that are not finite are skipped. A
    colour is a name (``"black"``, ``"grey"``, ``"white"``, ``"red"``, ``"orange"``, ``"yellow"``, ``"green"``,
    ``"blue"``, ``"purple"``) or three integers from 0 to 255. Sizes and widths are in pixels of a picture 640 wide and
    scale with wider ones; arguments ending with ``_m`` are in metres. In a view with depth, nearer surfaces hide the
    drawing. In the top view it covers everything else; only cells are drawn directly on the world, below everything
    else.
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
        """Draw straight lines from ``starts`` to ``ends``; either may be a single point.

        A path (K, 3) is ``lines(path[:-1], path[1:])``.
        """
        a, b = _places("starts", starts), _places("ends", ends)
        if len(a) != len(b) and 1 not in (len(a), len(b)):
            raise ValueError(f"ends: expected as many as starts ({len(a)}), or one for all, got {len(b)}")
        a, b = np.broadcast_arrays(a, b)
        both = _finite(a) & _finite(b)
        self._canvas.lines(a[both], b[both], _color(color), width_px=self._px("width", width))

    def spheres(self, centers: npt.ArrayLike, radius_m: float, color: str | tuple[int, int, int] = "orange") -> None:
        """Draw spheres of one radius. They are visible only from outside."""
        places = _places("centers", centers)
        radius, rgb = _positive("radius_m", radius_m), _color(color)
        for center in places[_finite(places)]:
            self._canvas.sphere(center, radius, rgb)

    def cells(self, centers: npt.ArrayLike, size_m: float, color: npt.ArrayLike = "orange") -> None:
        """Tint level squares with sides along x and y, for example as a coverage map or a heat map.

        Parameters
        ----------
        centers
            Centres of the squares, on the ground or a little above it.
        size_m
            Length of a side.
        color
            One for all, or integers (K, 3), one for each. If cells overlap, the last one wins.
        """
        places, size = _places("centers", centers), _positive("size_m", size_m)
        colors = np.asarray(color)
        if colors.ndim == 2 and len(colors) == len(places):
            rgb = np.array([_color(row) for row in colors], np.uint8).reshape(-1, 3)
        else:
            rgb = np.tile(np.array(_color(color), np.uint8), (len(places), 1))
        kept = _finite(places)
        self._canvas.cells(places[kept], size, rgb[kept])

    def text(
        self,
        position: npt.ArrayLike,
        string: str,
        color: str | tuple[int, int, int] = "black",
        size: float = 14,
    ) -> None:
        """Write a text centred at a position (3,); ``size`` is the line height. Needs Pillow."""
        place = _places("position", position)
        if len(place) != 1:
            raise ValueError(f"position: expected shape (3,), got {np.shape(position)}")
        if not isinstance(string, str):
            raise TypeError(f"string: expected a str, got {string!r}")
        rgb, height_px = _color(color), self._px("size", size)
        if string.strip() and _finite(place)[0]:
            self._canvas.stamp(place[0], _lettering(string, rgb, height_px))

    def _px(self, field: str, size: float) -> int:
        return max(round(_positive(field, size) * self._unit_px), 1)


class Overlay(Protocol):
    """An object that adds to the pictures of a task: the `Task` itself, or the `FlightOverlay` of a built-in one."""

    @property
    def markers(self) -> tuple[str, ...]:
        """The markers of the world to draw."""

    def draw(self, batch: Batch, env: int, drawing: Drawing) -> None:
        """Add to the picture of one env."""


@lru_cache(maxsize=256)
def _lettering(string: str, color: Color, height_px: int) -> Image:
    """Return a text (h, w, 4) with a black or white edge, so that it is readable on any background."""
    try:
        from PIL import Image as Pillow
        from PIL import ImageDraw, ImageFont
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("Drawing.text needs Pillow, which is not installed: pip install pillow") from error
    edge = COLORS["white" if sum(color) < 3 * 128 else "black"]
    style: dict[str, Any] = {
        "font": ImageFont.load_default(height_px),
        "stroke_width": max(round(_HALO * height_px), 1),
        "align": "center",
    }
    blank = Pillow.new("RGBA", (1, 1))
    left, top, right, bottom = ImageDraw.Draw(blank).multiline_textbbox((0, 0), string, **style)
    picture = Pillow.new("RGBA", (int(np.ceil(right - left)), int(np.ceil(bottom - top))), (*edge, 0))
    ImageDraw.Draw(picture).multiline_text((-left, -top), string, fill=color, stroke_fill=edge, **style)
    return np.asarray(picture)


def _places(field: str, value: npt.ArrayLike) -> Floats:
    refuse_masked(field, value)
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
            names, hint = ", ".join(COLORS), did_you_mean(color, COLORS)
            raise ValueError(f"color: expected one of {names} or (red, green, blue), got {color!r}{hint}")
        return COLORS[color]
    rgb = np.asarray(color)
    if rgb.shape != (3,) or rgb.dtype.kind not in "iu" or rgb.min() < 0 or rgb.max() > 255:
        raise ValueError(f"color: expected a name or three integers from 0 to 255, got {color!r}")
    return int(rgb[0]), int(rgb[1]), int(rgb[2])
