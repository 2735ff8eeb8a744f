"""Pictures from above: the room, its obstacles and markers, a drone and its LiDAR beams. NumPy only."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, World
from flockstep.task import rotate
from flockstep.viewer.beams import beams_of

Image: TypeAlias = npt.NDArray[np.uint8]
Points: TypeAlias = npt.NDArray[np.float64]
Color: TypeAlias = tuple[int, int, int]

_OUTSIDE: Color = (225, 225, 228)
_FLOOR: Color = (255, 255, 255)
_SOLID: Color = (120, 124, 132)
_START: Color = (214, 60, 50)
_WAYPOINT: Color = (238, 190, 40)
_GOAL: Color = (52, 160, 80)
_BEAM: Color = (250, 160, 120)
_HIT: Color = (200, 60, 30)
_DRONE: Color = (35, 70, 160)

_CIRCLE = np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 24, endpoint=False)), np.sin(a)], axis=1)
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_CYLINDER = np.concatenate([np.insert(_CIRCLE, 2, z, axis=1) for z in (-1.0, 1.0)])
_MARGIN = 0.02  # of the picture's side, left free around the world


class TopView:
    """Draws the envs of a batch from above, +x to the right and +y up, the whole world in a square picture.

    Parameters
    ----------
    batch
        Whose drones to draw.
    beams
        Whether to draw the LiDAR's beams. One that hits nothing is as long as the drone's range.
    size_px
        Side of the picture.
    """

    def __init__(self, batch: Batch, *, beams: bool = True, size_px: int = 256) -> None:
        self._batch = batch
        self._beams = beams
        self._hull = np.asarray(batch.drone.hull, float)
        self._canvases = [_Canvas(world, size_px) for world in batch.worlds]
        self._backgrounds: dict[int, Image] = {}

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (size_px, size_px, 3) uint8, a new array."""
        index = int(self._batch.world_index[env])
        canvas = self._canvases[index]
        if index not in self._backgrounds:
            self._backgrounds[index] = canvas.background(self._batch.worlds[index])
        image: Image = self._backgrounds[index].copy()
        if not self._batch.active[env]:
            return image
        position = np.asarray(self._batch.position[env], float)
        quat_wxyz = np.asarray(self._batch.quat_wxyz[env], float)
        if self._beams:
            origin, ends, hit = beams_of(self._batch, env)
            canvas.lines(image, origin, ends, _BEAM)
            canvas.dots(image, ends[hit], _HIT)
        canvas.polygon(image, position + rotate(quat_wxyz, self._hull), _DRONE)
        return image


class _Canvas:
    """Maps metres of a world to pixels of a square picture, and draws into it."""

    def __init__(self, world: World, size_px: int) -> None:
        low, high = np.asarray(world.bounds, float)[:, :2]
        self._size_px = size_px
        self._px_per_m = size_px * (1 - 2 * _MARGIN) / float(max(high - low))
        self._center = (low + high) / 2

    def background(self, world: World) -> Image:
        """Return a new picture with all of the world that does not move."""
        image = np.full((self._size_px, self._size_px, 3), _OUTSIDE, np.uint8)
        solids = []
        for primitive in world.primitives:
            points = _primitive_points(primitive)
            if primitive["kind"] == "room":
                self.polygon(image, points, _FLOOR)
            else:
                solids.append(points)
        for points in solids:
            self.polygon(image, points, _SOLID)
        for mesh in world.to_dict().get("meshes", []):
            vertices = np.asarray(mesh["vertices"], float)
            for triangle in np.asarray(mesh["triangles"], int):
                self.polygon(image, vertices[triangle], _SOLID)
        markers = [(world.start, _START), *((w, _WAYPOINT) for w in world.waypoints), (world.goal, _GOAL)]
        for position, color in markers:
            if position is not None:
                self.polygon(image, _sphere_points(np.asarray(position, float), world.marker_radius_m), color)
        return image

    def polygon(self, image: Image, points: Points, color: Color) -> None:
        """Fill the outline that points (K, 3) have from above."""
        outline = _convex_hull(self._pixels(points))
        first = np.clip(np.floor(outline.min(axis=0)).astype(int), 0, self._size_px)
        last = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 1, 0, self._size_px)
        x, y = np.meshgrid(np.arange(first[0], last[0]), np.arange(first[1], last[1]))
        inside = np.ones(x.shape, bool)
        for (ax, ay), (bx, by) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            inside &= (bx - ax) * (y - ay) - (by - ay) * (x - ax) >= 0
        if inside.any() and len(outline) > 2:
            image[first[1] : last[1], first[0] : last[0]][inside] = color
        else:  # a line, or finer than a pixel
            self.lines(image, points.mean(axis=0), points, color)

    def lines(self, image: Image, start: Points, ends: Points, color: Color) -> None:
        """Draw lines from one point (3,) to points (K, 3)."""
        if not len(ends):
            return
        begin, finish = self._pixels(start[None]), self._pixels(ends)
        count = int(np.abs(finish - begin).max()) + 2
        t = np.linspace(0, 1, count)[None, :, None]
        self._plot(image, (begin[:, None] + t * (finish - begin)[:, None]).reshape(-1, 2), color)

    def dots(self, image: Image, points: Points, color: Color) -> None:
        """Draw points (K, 3), two pixels wide."""
        pixels = self._pixels(points)
        for shift in ((0, 0), (1, 0), (0, 1), (1, 1)):
            self._plot(image, pixels + shift, color)

    def _pixels(self, points: Points) -> Points:
        x, y = ((points[:, :2] - self._center) * self._px_per_m).T
        return np.stack([x, -y], axis=1) + (self._size_px - 1) / 2

    def _plot(self, image: Image, pixels: Points, color: Color) -> None:
        column, row = np.rint(pixels).astype(int).T
        seen = (column >= 0) & (column < self._size_px) & (row >= 0) & (row < self._size_px)
        image[row[seen], column[seen]] = color


def _primitive_points(primitive: dict[str, Any]) -> Points:
    center, half = np.asarray(primitive["center"], float), np.asarray(primitive["half_extents"], float)
    if primitive["kind"] == "sphere":
        return _sphere_points(center, float(half[0]))
    turn = np.asarray(primitive["quat_wxyz"], float)
    if primitive["kind"] == "capsule":
        ends = center + rotate(turn, np.array([[0.0, 0.0, half[0] - half[2]], [0.0, 0.0, half[2] - half[0]]]))
        return np.concatenate([_sphere_points(end, float(half[0])) for end in ends])
    local = _CYLINDER if primitive["kind"] in ("cylinder", "disc") else _CORNERS
    return center + rotate(turn, local * half)


def _sphere_points(center: Points, radius: float) -> Points:
    return center + np.insert(radius * _CIRCLE, 2, 0.0, axis=1)


def _convex_hull(points: Points) -> Points:
    """Return the corners of the convex hull of points (K, 2), in order (monotone chain)."""
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered

    def chain(sequence: Points) -> list[Points]:
        kept: list[Points] = []
        for p in sequence:
            while len(kept) >= 2:
                (ax, ay), (bx, by) = kept[-2], kept[-1]
                if (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax) > 0:
                    break
                kept.pop()
            kept.append(p)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))
