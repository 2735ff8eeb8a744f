"""Relief maps of a world seen along an axis: cut off in front of a plane, coloured by height behind it."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep._core import World
from flockstep.pictures.depth_canvas import Color, Floats, Image
from flockstep.rotations import rotate

_NOTHING: Color = (225, 225, 228)
SOLID: Color = (96, 101, 112)  # area cut by the plane
_HEIGHTS = np.array([(252, 252, 250), (216, 229, 219), (174, 202, 197), (138, 168, 182), (114, 132, 162)], float)
_LIGHT = np.array([-0.4, 0.5, 0.77])  # direction to the light: right, up, towards the viewer (upper left)

#: For each view: the axes to the right, up and along the line of sight, and the viewer's side of the last axis.
VIEWS = {"top": (0, 1, 2, 1.0), "side": (0, 2, 1, -1.0)}


class Relief:
    """Makes pictures of a world's geometry by casting a ray per pixel, which treats primitives and meshes alike.

    Parameters
    ----------
    world
        Its markers are not drawn.
    view
        ``"top"``: from above, +x to the right and +y up. ``"side"``: along +y, +x to the right and +z up.
    low, high
        (2,) m: lower left and upper right corner of the rectangle to show.
    size_px
        Width and height of the pictures.
    """

    def __init__(self, world: World, view: str, low: Floats, high: Floats, size_px: tuple[int, int]) -> None:
        self._world = world
        self._right, self._up, self._axis, self._toward = VIEWS[view]
        self._low, self._high = np.asarray(low, float), np.asarray(high, float)
        self._size_px = size_px
        self._px_per_m = np.array(size_px) / (self._high - self._low)
        width, height = size_px
        shape = (height, width)
        self._places = np.zeros((height * width, 3))  # the pixels' centres
        right = self._low[0] + (np.arange(width) + 0.5) / self._px_per_m[0]
        up = self._high[1] - (np.arange(height) + 0.5) / self._px_per_m[1]
        self._places[:, self._right] = np.broadcast_to(right, shape).ravel()
        self._places[:, self._up] = np.broadcast_to(up[:, None], shape).ravel()
        primitives = world.primitives
        self._num_primitives = len(primitives)
        self._solids = _Solids([p for p in primitives if p["visible"]])
        self._ceilings = [
            self._toward * p["center"][self._axis] + p["half_extents"][self._axis]
            for p in primitives
            if p["kind"] == "room"
        ]
        self._heights = np.sort(self._toward * np.asarray(world.bounds, float)[:, self._axis])
        self._triangles: Floats | None = None  # (T, 3, 3), the whole world

    def picture(self, cut_m: float) -> Image:
        """Return a picture (height, width, 3), without everything on the viewer's side of the plane at ``cut_m``.

        The cut area is dark: solid primitives throughout, meshes and rooms along their surface, and places with a mesh
        above the plane and nothing below it, as inside a hill. Other surfaces are lighter the farther they lie
        below the cut.
        """
        below, above = self._heights
        # Stay inside the room, whose ceiling would hide everything, and close to the world, because float32 is coarse
        # far away.
        span = max(above - below, 1e-3)
        height = min(self._toward * cut_m, above + 0.01 * span, *(ceiling - 1e-3 * span for ceiling in self._ceilings))
        origins = self._places.copy()
        origins[:, self._axis] = self._toward * height
        reach = span + abs(height - below)  # to the far end of the world
        hit = self._cast(origins, -self._toward, reach)
        distance = hit["t_hit"].astype(float)
        seen = np.isfinite(distance)
        colors = np.full((len(origins), 3), _NOTHING, float)
        share = np.clip((height - distance[seen] - below) / span, 0, 1)
        colors[seen] = _ramp(share) * _shade(hit["normal"][seen], self._right, self._up, self._axis, self._toward)

        missed = np.flatnonzero(~seen)
        if len(missed):  # inside a hill, with a mesh above and nothing below
            above_it = self._cast(origins[missed], self._toward, reach)["primitive"]
            colors[missed[above_it >= self._num_primitives]] = SOLID
        image: Image = np.rint(colors).astype(np.uint8).reshape(*self._size_px[::-1], 3)
        cut_m = self._toward * height
        low, high = self._solids.low[:, self._axis], self._solids.high[:, self._axis]
        for index in np.flatnonzero((low < cut_m) & (cut_m < high)).tolist():
            self._fill(image, index, origins)
        self._outline(image, cut_m)
        return image

    def _cast(self, origins: Floats, direction: float, reach: float) -> dict[str, npt.NDArray[Any]]:
        along = np.zeros((len(origins), 3))
        along[:, self._axis] = direction
        return self._world.raycast(origins, along, reach)

    def _fill(self, image: Image, index: int, origins: Floats) -> None:
        """Draw the cut through a primitive."""
        axes = [self._right, self._up]
        a = (self._solids.low[index, axes] - self._low) * self._px_per_m
        b = (self._solids.high[index, axes] - self._low) * self._px_per_m
        width, height = self._size_px
        columns = slice(max(int(a[0]), 0), max(int(b[0]) + 1, 0))
        rows = slice(max(int(height - b[1]), 0), max(int(height - a[1]) + 1, 0))
        window = origins.reshape(height, width, 3)[rows, columns]
        image[rows, columns][self._solids.holds(index, window)] = SOLID

    def _outline(self, image: Image, cut_m: float) -> None:
        """Draw the lines along which surfaces cross the plane, at least one pixel wide."""
        if self._triangles is None:
            mesh = self._world.mesh(max(0.25 / float(self._px_per_m.min()), 1e-4))
            visible = self._world.objects()["visible"][mesh["objects"]]
            self._triangles = mesh["vertices"].astype(float)[mesh["triangles"][visible]]
        beyond = self._triangles[:, :, self._axis] > cut_m
        crossed = beyond.any(axis=1) & ~beyond.all(axis=1)
        corners, beyond = self._triangles[crossed], beyond[crossed]
        # One corner is the only one on its side; the plane cuts the two edges that begin there.
        alone = np.where(beyond.sum(axis=1) == 1, beyond.argmax(axis=1), beyond.argmin(axis=1))
        at = np.arange(len(corners))
        ends = []
        for other in (1, 2):
            a, b = corners[at, alone], corners[at, (alone + other) % 3]
            t = (cut_m - a[:, self._axis]) / (b - a)[:, self._axis]
            point = a + t[:, None] * (b - a)
            ends.append(point[:, [self._right, self._up]])
        begin, end = ((points - self._low) * self._px_per_m for points in ends)
        counts = np.ceil(np.abs(end - begin).max(axis=1, initial=0)).astype(int) + 1
        segment = np.repeat(np.arange(len(counts)), counts)
        step = np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)
        t = step / np.maximum(counts - 1, 1)[segment]
        places = begin[segment] + t[:, None] * (end - begin)[segment]
        width, height = self._size_px
        column, row = np.floor(places[:, 0]).astype(int), np.floor(height - places[:, 1]).astype(int)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        image[row[inside], column[inside]] = SOLID


_SOLIDS = ("box", "cylinder", "sphere", "capsule")
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


class _Solids:
    """The primitives of a world that have an interior."""

    def __init__(self, primitives: list[dict[str, Any]]) -> None:
        solids = [primitive for primitive in primitives if primitive["kind"] in _SOLIDS]
        self._kinds = [str(solid["kind"]) for solid in solids]
        self._centers, self._halves = (
            np.array([solid[name] for solid in solids], float).reshape(-1, 3) for name in ("center", "half_extents")
        )
        self._quats = np.array([solid["quat_wxyz"] for solid in solids], float).reshape(-1, 4)
        corners = self._centers[:, None] + rotate(self._quats[:, None], _CORNERS * self._halves[:, None])
        self.low, self.high = corners.min(axis=1), corners.max(axis=1)  # (K, 3): bounding boxes

    def holds(self, index: int, points: Floats) -> npt.NDArray[np.bool_]:
        """Return a mask of the points (..., 3) inside one primitive."""
        local = rotate(self._quats[index], points - self._centers[index], inverse=True)
        half, kind = self._halves[index], self._kinds[index]
        if kind == "box":
            return np.asarray((np.abs(local) <= half).all(axis=-1))
        if kind == "cylinder":
            return np.asarray((np.hypot(local[..., 0], local[..., 1]) <= half[0]) & (np.abs(local[..., 2]) <= half[2]))
        straight = half[2] - half[0]  # half-length of a capsule's straight part; 0 for a sphere
        local[..., 2] -= np.clip(local[..., 2], -straight, straight)
        return np.asarray(np.linalg.norm(local, axis=-1) <= half[0])


def _ramp(share: Floats) -> Floats:
    """Return the colours (K, 3) of heights, from 0 for the lowest to 1 for the highest point of the world."""
    at = np.linspace(0, 1, len(_HEIGHTS))
    return np.stack([np.interp(share, at, _HEIGHTS[:, channel]) for channel in range(3)], axis=-1)


def _shade(normals: Floats, right: int, up: int, axis: int, toward: float) -> Floats:
    """Return the brightness of faces (K, 3) as (K, 1): 1 if they face the viewer."""
    n = normals.astype(float)
    lit = np.maximum(n[:, right] * _LIGHT[0] + n[:, up] * _LIGHT[1] + toward * n[:, axis] * _LIGHT[2], 0)
    return np.asarray(np.minimum(0.55 + 0.45 * lit / _LIGHT[2], 1)[:, None])
