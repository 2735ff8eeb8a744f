"""Pictures from above: the world below a drone, markers, the drone and its LiDAR beams."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, World
from flockstep.pictures.depth_canvas import Color, Floats, Image, blended, overlap, tint
from flockstep.pictures.drawing import Drawing, Overlay, line_px
from flockstep.pictures.lines import beams_of, draw_move_lines, drones_of_env, with_beams
from flockstep.pictures.posed_bodies import outline, posed_bodies
from flockstep.pictures.relief import SOLID, Relief
from flockstep.rotations import rotate
from flockstep.task import MARKERS

_START: Color = (214, 60, 50)
_WAYPOINT: Color = (238, 190, 40)
_GOAL: Color = (52, 160, 80)
_BEAM: Color = (250, 160, 120)
_HIT: Color = (200, 60, 30)
_DRONE: Color = (35, 70, 160)
_BODY: Color = (190, 95, 60)

_CIRCLE = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 24, endpoint=False)), np.sin(a), 0 * a], axis=1)
_MARGIN = 0.02  # free margin around the world, as a fraction of the picture's side
_WORLDS = 64  # maximum number of cached worlds
_LEAST_PX = 7  # minimum drawn size of drones and markers


class TopView:
    """Draws the envs of a batch from above, with +x to the right, +y up and the whole world in the picture.

    Everything above the drone is cut away. The cut area is dark; other surfaces are lighter the farther they lie below
    the cut.

    Parameters
    ----------
    batch
        The batch with the drones to draw.
    beams
        Draw the LiDAR's beams even if `Batch.set_beams_visible` does not show them. A beam without a hit is as long as
        the LiDAR's range.
    size_px
        Width and height of the picture. None: 256 x 256.
    cut_m
        Height of the cut in m. None: the drone's height.
    markers
        The markers of the world to draw.
    overlay
        A `Task` or a `FlightOverlay`, whose `draw` adds to the pictures. None: no additions.
    """

    def __init__(
        self,
        batch: Batch,
        *,
        beams: bool = True,
        size_px: tuple[int, int] | None = None,
        cut_m: float | None = None,
        markers: Sequence[str] = MARKERS,
        overlay: Overlay | None = None,
    ) -> None:
        self._batch = batch
        self._beams = beams
        self._cut_m = cut_m
        self._markers = tuple(markers)
        self._overlay = overlay
        self._hull = np.asarray(batch.drone.hull, float)
        self._size_px = size_px or (256, 256)
        self._line_px = line_px(self._size_px[0])
        self._canvases: dict[int, _Canvas] = {}

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height, width, 3) uint8, a new array."""
        index = int(self._batch.world_index[env // self._batch.drones_per_env])
        if index not in self._canvases:
            if len(self._canvases) >= _WORLDS:
                self._canvases.clear()
            self._canvases[index] = _Canvas(self._batch.world_of(env), self._markers, self._size_px)
        canvas = self._canvases[index]
        position = np.asarray(self._batch.position[env], float)
        hull = rotate(np.asarray(self._batch.quat_wxyz[env], float), self._hull)
        canvas.clear(float(position[2] + hull[:, 2].max()) if self._cut_m is None else self._cut_m)
        for body in posed_bodies(self._batch, env // self._batch.drones_per_env):
            canvas.polygon(outline(body), _BODY)
        draw_move_lines(canvas, self._batch, drones_of_env(self._batch, env), 2 * self._line_px)
        if self._batch.active[env]:
            for drone in with_beams(self._batch, env, self._beams):
                origin, ends, hit = beams_of(self._batch, drone)
                canvas.lines(origin[None], ends, _BEAM, width_px=self._line_px)
                canvas.dots(ends[hit], _HIT, size_px=2 * self._line_px)
            canvas.polygon(position + hull * canvas.enlarged(float(np.ptp(hull, axis=0)[:2].max())), _DRONE)
            if self._overlay is not None:  # last, so that a target at the drone's position stays visible
                self._overlay.draw(self._batch, env, Drawing(canvas, self._line_px))
        return canvas.image


class _Canvas:
    """Maps metres of a world to pixels of a picture from above, and draws into it."""

    def __init__(self, world: World, markers: Sequence[str], size_px: tuple[int, int]) -> None:
        self._world = world
        self._places = [
            *((place, _START) for place in [world.start] if place is not None and "start" in markers),
            *((place, _WAYPOINT) for place in world.waypoints if "waypoints" in markers),
            *((place, _GOAL) for place in [world.goal] if place is not None and "goal" in markers),
        ]
        corners = np.concatenate(
            [np.asarray(world.bounds, float), *(np.array(p, float)[None] for p, _ in self._places)]
        )
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        size = np.array(size_px, float)
        self._px_per_m = float((size * (1 - 2 * _MARGIN) / np.maximum(high - low, 1e-6)).min())
        self._center = (low + high) / 2
        self._size_px = size_px
        half = size / self._px_per_m / 2
        self._relief = Relief(world, "top", self._center - half, self._center + half, size_px)
        self._cut_m = np.nan  # height of the cached relief
        self._background: Image
        self._ground: npt.NDArray[np.bool_]  # (height, width), pixels that are free for cells
        self.image: Image

    def clear(self, cut_m: float) -> None:
        """Begin a new picture with the static part of the world, cut off above a height."""
        if cut_m != self._cut_m:
            self._background, self._cut_m = self._relief.picture(cut_m), cut_m
        self.image = self._background.copy()
        self._ground = (self.image != SOLID).any(axis=-1)
        for place, color in self._places:
            radius = self._world.marker_radius_m
            self.sphere(np.asarray(place, float), radius * self.enlarged(2 * radius), color)

    def enlarged(self, length_m: float) -> float:
        """Return the scale factor at which an object of this length stays visible."""
        return max(_LEAST_PX / (length_m * self._px_per_m), 1.0)

    def polygon(self, points: Floats, color: Color) -> None:
        """Fill the outline of points (K, 3) seen from above."""
        outline = _convex_hull(self._pixels(points))
        left, top = np.clip(np.floor(outline.min(axis=0)).astype(int), 0, self._size_px)
        right, bottom = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 1, 0, self._size_px)
        x, y = np.meshgrid(np.arange(left, right), np.arange(top, bottom))
        inside = np.ones(x.shape, bool)
        for (ax, ay), (bx, by) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0
        if inside.any() and len(outline) > 2:
            self.image[top:bottom, left:right][inside] = color
            self._ground[top:bottom, left:right][inside] = False
        else:  # a line, or finer than a pixel
            self.lines(points.mean(axis=0)[None], points, color)

    def sphere(self, center: Floats, radius_m: float, color: Color) -> None:
        """Draw a sphere as a disc."""
        self.polygon(center + radius_m * _CIRCLE, color)

    def lines(self, starts: Floats, ends: Floats, color: Color, *, width_px: int = 1) -> None:
        """Draw lines between points (K, 3) and (K, 3), or from one point to all others."""
        if not len(ends):
            return
        begin, finish = self._clipped(*np.broadcast_arrays(self._pixels(starts), self._pixels(ends)))
        if not len(begin):
            return
        count = int(np.abs(finish - begin).max()) + 2
        t = np.linspace(0, 1, count)[None, :, None]
        self._plot((begin[:, None] + t * (finish - begin)[:, None]).reshape(-1, 2), color, width_px)

    def dots(self, points: Floats, color: Color, *, size_px: int = 1) -> None:
        """Draw points (K, 3) as squares."""
        self._plot(self._pixels(points), color, size_px)

    def cells(self, centers: Floats, size_m: float, colors: Image) -> None:
        """Tint squares around points (K, 3) in colours (K, 3), over the uncut world and below everything else."""
        middle, half = self._pixels(centers), size_m * self._px_per_m / 2
        edges = np.clip([middle - half, middle + half], -1, self._size_px)
        # Round to whole pixels, so that neighbours neither overlap nor leave gaps; at least one pixel, to be visible.
        first, end = np.ceil(edges - 1e-6).astype(int)
        first, end = np.clip([first, np.maximum(end, first + 1)], 0, self._size_px)
        last = np.full(self._ground.shape, -1)  # index of the last cell at each pixel
        for index, ((left, top), (right, bottom)) in enumerate(zip(first, end, strict=True)):
            last[top:bottom, left:right] = index
        last[~self._ground] = -1
        tint(self.image, last, colors)

    def stamp(self, place: Floats, picture: Image) -> None:
        """Put a picture (h, w, 4), whose last channel is its opacity, with its middle at a position (3,)."""
        ((column, row),) = self._pixels(place[None]) + 0.5
        window, part = overlap(self.image.shape, picture.shape, row, column)
        opacity = picture[part][..., 3] / 255
        self.image[window] = blended(self.image[window], picture[part][..., :3], opacity)
        self._ground[window] &= opacity == 0

    def _pixels(self, points: Floats) -> Floats:
        x, y = ((points[:, :2] - self._center) * self._px_per_m).T
        return np.stack([x, -y], axis=1) + (np.array(self._size_px) - 1) / 2

    def _clipped(self, begin: Floats, end: Floats) -> tuple[Floats, Floats]:
        """Return the parts of lines (K, 2) to (K, 2) inside the picture."""
        low, high = np.full(2, -1.0), np.array(self._size_px, float)
        with np.errstate(divide="ignore", invalid="ignore"):
            to_low, to_high = (low - begin) / (end - begin), (high - begin) / (end - begin)
        level = end == begin
        within = (begin >= low) & (begin <= high)
        first = np.where(level, np.where(within, 0, 2), np.minimum(to_low, to_high)).max(axis=1).clip(0)
        last = np.where(level, np.where(within, 1, -1), np.maximum(to_low, to_high)).min(axis=1).clip(max=1)
        seen = first <= last
        along = (end - begin)[seen]
        return begin[seen] + first[seen, None] * along, begin[seen] + last[seen, None] * along

    def _plot(self, pixels: Floats, color: Color, size_px: int) -> None:
        shifts = np.arange(size_px) - (size_px - 1) // 2
        column, row = np.rint(pixels).astype(int).T
        column = (column[:, None, None] + shifts).repeat(size_px, axis=1).ravel()
        row = (row[:, None, None] + shifts[:, None]).repeat(size_px, axis=2).ravel()
        seen = (column >= 0) & (column < self._size_px[0]) & (row >= 0) & (row < self._size_px[1])
        self.image[row[seen], column[seen]] = color
        self._ground[row[seen], column[seen]] = False


def _convex_hull(points: Floats) -> Floats:
    """Return the corners of the convex hull of points (K, 2), in order (monotone chain)."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered

    def chain(sequence: Floats) -> list[Floats]:
        kept: list[Floats] = []
        for p in sequence:
            while len(kept) >= 2:
                (ax, ay), (bx, by) = kept[-2], kept[-1]
                if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0:
                    break
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))
