"""Draw lines, dots, spheres, cells and texts into a camera's picture, hidden by what is nearer. NumPy only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import CameraConfig
from flockstep.rotations import rotate

Image: TypeAlias = npt.NDArray[np.uint8]
Floats: TypeAlias = npt.NDArray[np.floating[Any]]
Ints: TypeAlias = npt.NDArray[np.intp]
Color: TypeAlias = tuple[int, int, int]
Window: TypeAlias = tuple[slice, slice]

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], float)
_CELL_OPACITY = 0.6  # the surface below a cell still shows
_BIAS_M = 0.01  # tolerance, so that points on a surface pass the depth test
_BIAS = 1e-3  # the same, as a fraction of the distance


class DepthCanvas:
    """A picture to draw into.

    A pixel has a square of samples. A drawing that covers some of them is mixed with what was there before.

    Parameters
    ----------
    rgb, depth
        (H, W, 3) and planar (H, W) m, taken by the camera at this pose. Drawing changes both in place.
    camera
        The camera that took them. Its mounting on a drone is ignored.
    position, quat_wxyz
        Pose of the camera itself, (3,) m and (4,), in the world frame.
    light
        The world's light, as in `World.light`, for shading.
    finer
        Samples along a side of a pixel. They are the unit of widths and sizes.
    """

    def __init__(
        self,
        rgb: Image,
        depth: npt.NDArray[np.float32],
        camera: CameraConfig,
        position: Floats,
        quat_wxyz: Floats,
        light: Mapping[str, Any],
        finer: int = 1,
    ) -> None:
        self.rgb = rgb
        self.depth = depth
        self._finer = finer
        self._size = finer * np.array([camera.width_px, camera.height_px])  # in samples
        self._position = np.asarray(position, float)
        self._axes = rotate(np.asarray(quat_wxyz, float), np.eye(3))  # the camera's, as rows
        self._light = {name: np.asarray(value, float) for name, value in light.items()}
        self._near = camera.near_m
        self._focal = finer * np.array([camera.fx, camera.fy])
        self._center = finer * np.array([camera.cx, camera.cy])
        # The frustum in the camera's frame: a point p is inside if sides @ p >= (near, 0, 0, 0, 0).
        (width, height), (fx, fy), (cx, cy) = self._size, self._focal, self._center
        self._sides = np.array(
            [[1, 0, 0], [cx / fx, -1, 0], [(width - cx) / fx, 1, 0], [cy / fy, 0, -1], [(height - cy) / fy, 0, 1]]
        )

    def project(self, points: Floats) -> Floats:
        """Project points (K, 3) in front to (K, 3): pixels from the left and from the upper border, depth in m."""
        return self._project(self._to_camera(points)) / [self._finer, self._finer, 1]

    def lines(self, starts: Floats, ends: Floats, color: Color, *, width_px: int = 1, opacity: float = 1.0) -> None:
        """Draw lines between points (K, 3) and (K, 3)."""
        a, b = self._clip(self._to_camera(np.atleast_2d(starts)), self._to_camera(np.atleast_2d(ends)))
        if not len(a):
            return
        begin, end = self._project(a), self._project(b)
        # One point per sample along each line's longer side; inverse depth is linear between them.
        begin[:, 2], end[:, 2] = 1 / begin[:, 2], 1 / end[:, 2]
        counts = np.ceil(np.abs(end - begin)[:, :2].max(axis=1)).astype(int) + 1
        line, step = _counted(counts)
        t = step / np.maximum(counts - 1, 1)[line]
        points = begin[line] + t[:, None] * (end - begin)[line]
        self._plot(points[:, 0], points[:, 1], 1 / points[:, 2], color, width_px, opacity)

    def dots(self, points: Floats, color: Color, *, size_px: int = 1) -> None:
        """Draw points (K, 3) as squares."""
        local = self._to_camera(points)
        x, y, depth = self._project(local[local[:, 0] >= self._near]).T
        self._plot(x, y, depth, color, size_px, 1.0)

    def sphere(
        self, center: Floats, radius_m: float, color: Color, opacity: Callable[[Floats], Floats] = np.ones_like
    ) -> None:
        """Draw a shaded sphere, with an opacity for each depth. It is invisible from inside."""
        local = self._to_camera(np.atleast_2d(center))[0]
        if local[0] + radius_m < self._near:
            return
        low, high = np.zeros(2), self._size.astype(float)
        if local[0] - radius_m >= self._near:  # it is inside its bounding cube
            pixels = self._project(local + radius_m * _CORNERS)[:, :2]
            low, high = np.maximum(low, pixels.min(axis=0)), np.minimum(high, pixels.max(axis=0))
        (left, top), (right, bottom) = np.floor(low).astype(int), np.ceil(high).astype(int)
        if left >= right or top >= bottom:
            return
        # A sample's ray is at depth * (1, y, z). A quadratic equation gives the depth at which it enters the sphere.
        rays = self._rays(np.s_[top:bottom, left:right])
        a, b = (rays * rays).sum(axis=-1), rays @ local
        discriminant = b * b - a * (local @ local - radius_m * radius_m)
        enter = (b - np.sqrt(np.maximum(discriminant, 0))) / a
        row, column = np.nonzero((discriminant > 0) & (enter >= self._near))
        depth = enter[row, column]
        normals = (depth[:, None] * rays[row, column] - local) / radius_m @ self._axes
        linear = (np.array(color) / 255) ** float(self._light["gamma"])
        self._cover(top + row, left + column, depth, self._shaded(normals, linear), opacity(depth), bias=False)

    def cells(self, centers: Floats, size_m: float, colors: Image) -> None:
        """Tint level squares around points (K, 3), with sides along x and y, each in a colour (K, 3)."""
        half, offsets = size_m / 2, centers - self._position
        corners = self._to_camera(centers[:, None] + half * _SQUARE)
        # Position of a sample's ray relative to the camera at planar depth 1: along x, along y, above.
        rays = self._rays(np.s_[: self._size[1], : self._size[0]]) @ self._axes
        surface = self.depth.repeat(self._finer, axis=0).repeat(self._finer, axis=1) * (1 + _BIAS) + _BIAS_M
        last = np.full(surface.shape, -1)  # index of the last cell at each sample
        for index, (x, y, z) in enumerate(offsets):
            outline = _beyond(corners[index], self._near)
            if not len(outline):
                continue
            pixels = self._project(outline)[:, :2]
            first, end = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
            (c0, r0), (c1, r1) = np.clip([first, end], 0, self._size).astype(int)
            window = np.s_[r0:r1, c0:c1]
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = z / rays[window][..., 2]
                along_x, along_y = depth * rays[window][..., 0] - x, depth * rays[window][..., 1] - y
            seen = (-half <= along_x) & (along_x < half) & (-half <= along_y) & (along_y < half)
            seen &= (depth >= self._near) & (depth <= surface[window])
            last[window][seen] = index
        row, column = np.nonzero(last >= 0)
        depth = self.depth[row // self._finer, column // self._finer]  # it stays
        self._cover(row, column, depth, colors[last[row, column]], _CELL_OPACITY)

    def stamp(self, place: Floats, picture: Image) -> None:
        """Put a picture (h, w, 4), whose last channel is its opacity, at a position (3,): all of it at that depth."""
        local = self._to_camera(place[None])
        if local[0, 0] < self._near:
            return
        ((x, y, depth),) = self._project(local)
        (rows, columns), part = overlap((self._size[1], self._size[0]), picture.shape, y, x)
        row, column = np.nonzero(picture[part][..., 3])
        shown = picture[part][row, column]
        at = rows.start + row, columns.start + column
        self._cover(*at, np.full(len(row), depth), shown[:, :3], shown[:, 3] / 255)

    def _rays(self, window: Window) -> Floats:
        """Return (1, y, z) of the samples of a window: their rays at planar depth 1, in the camera's frame."""
        rows, columns = (np.arange(part.start or 0, part.stop) + 0.5 for part in window)
        y, z = np.meshgrid((self._center[0] - columns) / self._focal[0], (self._center[1] - rows) / self._focal[1])
        rays: Floats = np.stack([np.ones_like(y), y, z], axis=-1)
        return rays

    def _shaded(self, normals: Floats, base_color: Floats) -> Image:
        """Return the camera colours (F, 3) of faces with base colours (3,) or (F, 3), linear RGB."""
        light = self._light
        sun = np.maximum(normals @ light["sun_direction"], 0)[:, None] * light["sun_color"]
        up = (1 + normals[:, 2:]) / 2
        ambient = light["ground_ambient"] + up * (light["sky_ambient"] - light["ground_ambient"])
        values: Floats = 255 * np.minimum(base_color * (sun + ambient), 1) ** (1 / light["gamma"])
        return np.rint(values).astype(np.uint8)

    def _to_camera(self, points: Floats) -> Floats:
        local: Floats = (np.asarray(points, float) - self._position) @ self._axes.T
        return local

    def _project(self, local: Floats) -> Floats:
        pixels = self._center - local[:, 1:] / local[:, :1] * self._focal
        return np.concatenate([pixels, local[:, :1]], axis=1)

    def _clip(self, a: Floats, b: Floats) -> tuple[Floats, Floats]:
        """Return the parts inside the frustum of lines from a (K, 3) to b (K, 3)."""
        near = np.array([self._near, 0, 0, 0, 0])
        of_a, of_b = a @ self._sides.T - near, b @ self._sides.T - near
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = of_a / (of_a - of_b)
        first = np.where(of_a < 0, crossing, 0).max(axis=1, initial=0)
        last = np.where(of_b < 0, crossing, 1).min(axis=1, initial=1)
        inside = ~((of_a < 0) & (of_b < 0)).any(axis=1) & (first <= last)
        a, along = a[inside], (b - a)[inside]
        return a + first[inside, None] * along, a + last[inside, None] * along

    def _plot(self, x: Floats, y: Floats, depth: Floats, color: Color, size: int, opacity: float) -> None:
        """Draw squares of samples around points (K,). What several of them cover is drawn once."""
        shifts = np.arange(size) - size // 2
        column = (np.floor(x).astype(int)[:, None, None] + shifts).repeat(size, axis=1).ravel()
        row = (np.floor(y).astype(int)[:, None, None] + shifts[:, None]).repeat(size, axis=2).ravel()
        self._cover(row, column, depth.repeat(size * size), np.array([color]), opacity)

    def _cover(
        self, row: Ints, column: Ints, depth: Floats, colors: Image, opacity: Floats | float, *, bias: bool = True
    ) -> None:
        """Mix colours (K, 3) into samples at depths (K,), where they are not hidden; one colour is that of them all.

        Samples that stand several times are mixed in once, in the one colour. Opaque ones hide what is drawn later.
        """
        finer, width = self._finer, self.depth.shape[1]
        inside = (column >= 0) & (column < self._size[0]) & (row >= 0) & (row < self._size[1])
        at = row // finer * width + column // finer
        flat = self.depth.reshape(-1)
        inside[inside] = depth[inside] <= flat[at[inside]] * (1 + _BIAS * bias) + _BIAS_M * bias
        if not inside.any():
            return
        at, row, column, depth = at[inside], row[inside], column[inside], depth[inside]
        first = int(at.min())
        count = int(at.max()) - first + 1
        below = self.rgb.reshape(-1, 3)[first : first + count]
        if len(colors) == 1:
            covered = np.zeros((count, finer * finer), bool)
            covered[at - first, row % finer * finer + column % finer] = True
            touched, samples = np.unique(np.flatnonzero(covered) // finer**2, return_counts=True)
            share = samples * np.asarray(opacity, float)
            solid, total = np.full(len(at), opacity == 1), share[:, None] * colors
        else:
            weight = np.broadcast_to(opacity, inside.shape)[inside]
            weights, solid = np.bincount(at - first, weight), weight > 0.5
            touched = np.flatnonzero(weights)
            share = weights[touched]
            total = np.stack([np.bincount(at - first, weight * by)[touched] for by in colors[inside].T], axis=1)
        below[touched] = np.rint(below[touched] + (total - share[:, None] * below[touched]) / finer**2)
        np.minimum.at(flat, at[solid], depth[solid].astype(np.float32))


def blended(below: Image, above: Image, opacity: Floats) -> Image:
    """Blend colours (..., 3) over others with an opacity (...) in [0, 1]."""
    behind = below.astype(float)
    image: Image = np.rint(behind + opacity[..., None] * (above - behind)).astype(np.uint8)
    return image


def tint(rgb: Image, cell: Ints, colors: Image) -> None:
    """Tint the pixels of a picture (H, W, 3) in the colours (K, 3) of their cells (H, W); skip cell -1."""
    at = cell >= 0
    rgb[at] = blended(rgb[at], colors[cell[at]], np.array([_CELL_OPACITY]))


def overlap(shape: tuple[int, ...], size: tuple[int, ...], row: float, column: float) -> tuple[Window, Window]:
    """Return the window that a picture centred at (row, column) covers in an image, and its visible part."""
    covered, by = [], []
    for whole, length, middle in zip(shape, size, (row, column), strict=False):
        begin = round(middle - length / 2)
        first, end = (min(max(edge, 0), whole) for edge in (begin, begin + length))
        covered.append(slice(first, end))
        by.append(slice(first - begin, end - begin))
    return (covered[0], covered[1]), (by[0], by[1])


def _counted(counts: Ints) -> tuple[Ints, Ints]:
    """Repeat items ``counts`` (K,) times; return item and repetition indices. Counts below 0 mean none."""
    counts = np.maximum(counts, 0)
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)


def _beyond(corners: Floats, near: float) -> Floats:
    """Return the unordered corners (V, 3) of the part of a polygon (K, 3), in the camera's frame, beyond a depth."""
    sides = np.roll(corners, -1, axis=0) - corners
    ahead = corners[:, 0] >= near
    cut = ahead != np.roll(ahead, -1)
    crossings = corners[cut] + ((near - corners[cut, 0]) / sides[cut, 0])[:, None] * sides[cut]
    return np.concatenate([corners[ahead], crossings])
