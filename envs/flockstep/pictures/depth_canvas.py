"""Draw lines, dots and solids into a camera's frame, with depth test. NumPy only."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
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
    """A frame to draw into.

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
    """

    def __init__(
        self,
        rgb: Image,
        depth: npt.NDArray[np.float32],
        camera: CameraConfig,
        position: Floats,
        quat_wxyz: Floats,
        light: Mapping[str, Any],
    ) -> None:
        self.rgb = rgb
        self.depth = depth
        self._position = np.asarray(position, float)
        self._quat_wxyz = np.asarray(quat_wxyz, float)
        self._light = {name: np.asarray(value, float) for name, value in light.items()}
        self._near = camera.near_m
        self._focal = np.array([camera.fx, camera.fy])
        self._center = np.array([camera.cx, camera.cy])
        # The frustum in the camera's frame: a point p is inside if sides @ p >= (near, 0, 0, 0, 0).
        width, height = camera.width_px, camera.height_px
        self._sides = np.array(
            [
                [1, 0, 0],
                [camera.cx / camera.fx, -1, 0],
                [(width - camera.cx) / camera.fx, 1, 0],
                [camera.cy / camera.fy, 0, -1],
                [(height - camera.cy) / camera.fy, 0, 1],
            ]
        )

    def copy(self) -> DepthCanvas:
        """Return a copy with its own pixels."""
        other = copy(self)
        other.rgb, other.depth = self.rgb.copy(), self.depth.copy()
        return other

    def project(self, points: Floats) -> Floats:
        """Project points (K, 3) in front to (K, 3): pixels from the left and from the upper border, depth in m."""
        return self._project(self._to_camera(points))

    def lines(self, starts: Floats, ends: Floats, color: Color, *, width_px: int = 1, opacity: float = 1.0) -> None:
        """Draw lines between points (K, 3) and (K, 3)."""
        a, b = self._clip(self._to_camera(np.atleast_2d(starts)), self._to_camera(np.atleast_2d(ends)))
        if not len(a):
            return
        begin, end = self._project(a), self._project(b)
        # One sample per pixel along each line's longer side; inverse depth is linear between them.
        begin[:, 2], end[:, 2] = 1 / begin[:, 2], 1 / end[:, 2]
        counts = np.ceil(np.abs(end - begin)[:, :2].max(axis=1)).astype(int) + 1
        line, step = _counted(counts)
        t = step / np.maximum(counts - 1, 1)[line]
        samples = begin[line] + t[:, None] * (end - begin)[line]
        self._plot(samples[:, 0], samples[:, 1], 1 / samples[:, 2], color, width_px, opacity)

    def dots(self, points: Floats, color: Color, *, size_px: int = 1) -> None:
        """Draw points (K, 3) as squares."""
        local = self._to_camera(points)
        x, y, depth = self._project(local[local[:, 0] >= self._near]).T
        self._plot(x, y, depth, color, size_px, 1.0)

    def solid(self, normals: Floats, offsets: Floats, corners: Floats, colors: Image) -> None:
        """Draw the convex body of the points p with normals (F, 3) . p <= offsets (F,), each face in a color (F, 3).

        The corners (V, 3) bound its area in the frame.
        """
        height, width = self.depth.shape
        local = self._to_camera(corners)
        low, high = np.zeros(2), np.array([width, height], float)
        if local[:, 0].min() >= self._near:
            pixels = self._project(local)[:, :2]
            low, high = np.maximum(low, pixels.min(axis=0)), np.minimum(high, pixels.max(axis=0))
        elif local[:, 0].max() < self._near:
            return
        left, top = np.floor(low).astype(int)
        right, bottom = np.ceil(high).astype(int)
        if left >= right or top >= bottom:
            return
        # At planar depth d a pixel's ray is at d * (1, y, z). It is inside a face's half-space up to, or from, the
        # depth at which it crosses the plane.
        y = ((self._center[0] - np.arange(left, right) - 0.5) / self._focal[0])[None, :]
        z = ((self._center[1] - np.arange(top, bottom) - 0.5) / self._focal[1])[:, None]
        enter = np.full((bottom - top, right - left), -np.inf)
        leave = np.full_like(enter, np.inf)
        face = np.zeros(enter.shape, int)
        tilts = rotate(self._quat_wxyz, np.asarray(normals, float), inverse=True)
        for index, (tilt, offset) in enumerate(zip(tilts, offsets - normals @ self._position, strict=True)):
            slope = tilt[0] + tilt[1] * y + tilt[2] * z
            with np.errstate(divide="ignore", invalid="ignore"):
                meets = offset / slope
            entering = (slope < 0) & (meets > enter)
            enter[entering] = meets[entering]
            face[entering] = index
            np.minimum(leave, meets, out=leave, where=slope > 0)
            if offset < 0:
                leave[slope == 0] = -np.inf
        window = np.s_[top:bottom, left:right]
        seen = (enter < leave) & (enter >= self._near) & (enter.astype(np.float32) < self.depth[window])
        self.rgb[window][seen] = colors[face[seen]]
        self.depth[window][seen] = enter[seen]

    def triangles(self, corners: Floats, colors: Image) -> None:
        """Draw triangles (T, 3, 3), each in a color (T, 3), seen from both sides."""
        local = self._to_camera(corners.reshape(-1, 3)).reshape(-1, 3, 3)
        local, colors = self._ahead(local, colors)
        if not len(local):
            return
        height, width = self.depth.shape
        points = self._project(local.reshape(-1, 3)).reshape(-1, 3, 3)
        order = np.argsort(points[:, :, 1], axis=1)  # from the top down, so that neighbours round a shared edge alike
        top, middle, bottom = np.moveaxis(np.take_along_axis(points, order[:, :, None], axis=1), 1, 0)
        # Select the rows whose centre is inside a triangle, between the long side and one of the others; then the
        # pixels of each row in the same way.
        first, end = (np.clip(np.ceil(y - 0.5), 0, height).astype(int) for y in (top[:, 1], bottom[:, 1]))
        which, step = _counted(end - first)
        row = first[which] + step
        y = row + 0.5
        upper = y < middle[which, 1]
        near, far = np.where(upper, top[which].T, middle[which].T), np.where(upper, middle[which].T, bottom[which].T)
        sides = np.sort([_crossing(y, top[which].T, bottom[which].T), _crossing(y, near, far)], axis=0)
        left, right = np.clip(np.ceil(sides - 0.5), 0, width).astype(int)
        span, step = _counted(right - left)
        which, row, column = which[span], row[span], left[span] + step
        # A pixel's ray is at depth * (1, y, z). Its depth is on the triangle's plane, clamped to the depths of the
        # corners.
        normals = np.cross(local[:, 1] - local[:, 0], local[:, 2] - local[:, 0])
        offsets = (normals * local[:, 0]).sum(axis=1)
        slope = normals[which, 0] + normals[which, 1] * ((self._center[0] - column - 0.5) / self._focal[0])
        slope += normals[which, 2] * ((self._center[1] - row - 0.5) / self._focal[1])
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = offsets[which] / slope
        depth = np.clip(depth, local[:, :, 0].min(axis=1)[which], local[:, :, 0].max(axis=1)[which]).astype(np.float32)
        at = row * width + column
        seen = np.flatnonzero(depth < self.depth.reshape(-1)[at])
        seen = seen[np.argsort(-depth[seen], kind="stable")]  # the nearest comes last and wins
        self.rgb.reshape(-1, 3)[at[seen]] = colors[which[seen]]
        self.depth.reshape(-1)[at[seen]] = depth[seen]

    def sphere(self, center: Floats, radius_m: float, color: Color) -> None:
        """Draw a shaded sphere. It is invisible from inside."""
        local = self._to_camera(np.atleast_2d(center))[0]
        if local[0] + radius_m < self._near:
            return
        height, width = self.depth.shape
        low, high = np.zeros(2), np.array([width, height], float)
        if local[0] - radius_m >= self._near:  # it is inside its bounding cube
            pixels = self._project(local + radius_m * _CORNERS)[:, :2]
            low, high = np.maximum(low, pixels.min(axis=0)), np.minimum(high, pixels.max(axis=0))
        left, top = np.floor(low).astype(int)
        right, bottom = np.ceil(high).astype(int)
        if left >= right or top >= bottom:
            return
        # A pixel's ray is at depth * (1, y, z). A quadratic equation gives the depth at which it enters the sphere.
        y, z = np.meshgrid(
            (self._center[0] - np.arange(left, right) - 0.5) / self._focal[0],
            (self._center[1] - np.arange(top, bottom) - 0.5) / self._focal[1],
        )
        rays = np.stack([np.ones_like(y), y, z], axis=-1)
        a, b = (rays * rays).sum(axis=-1), rays @ local
        discriminant = b * b - a * (local @ local - radius_m * radius_m)
        enter = (b - np.sqrt(np.maximum(discriminant, 0))) / a
        window = np.s_[top:bottom, left:right]
        seen = (discriminant > 0) & (enter >= self._near) & (enter.astype(np.float32) < self.depth[window])
        normals = rotate(self._quat_wxyz, (enter[seen, None] * rays[seen] - local) / radius_m)
        linear = (np.array(color) / 255) ** float(self._light["gamma"])
        self.rgb[window][seen] = self.shaded(normals, linear)
        self.depth[window][seen] = enter[seen]

    def cells(self, centers: Floats, size_m: float, colors: Image) -> None:
        """Tint level squares around points (K, 3), with sides along x and y, each in a colour (K, 3)."""
        half, offsets = size_m / 2, centers - self._position
        corners = self._to_camera(centers[:, None] + half * _SQUARE)
        # Position of a pixel's ray relative to the camera at planar depth 1: along x, along y, above.
        height, width = self.depth.shape
        left = (self._center[0] - np.arange(width) - 0.5) / self._focal[0]
        up = (self._center[1] - np.arange(height) - 0.5)[:, None] / self._focal[1]
        axes = rotate(self._quat_wxyz, np.eye(3), inverse=True)
        rays = [axis[0] + axis[1] * left + axis[2] * up for axis in axes]
        last = np.full((height, width), -1)  # index of the last cell at each pixel
        for index, (x, y, z) in enumerate(offsets):
            outline = _beyond(corners[index], self._near)
            if not len(outline):
                continue
            pixels = self._project(outline)[:, :2]
            first, end = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
            (c0, r0), (c1, r1) = np.clip([first, end], 0, (width, height)).astype(int)
            window = np.s_[r0:r1, c0:c1]
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = z / rays[2][window]
                along_x, along_y = depth * rays[0][window] - x, depth * rays[1][window] - y
            seen = (-half <= along_x) & (along_x < half) & (-half <= along_y) & (along_y < half)
            seen &= (depth >= self._near) & (depth <= self.depth[window] * (1 + _BIAS) + _BIAS_M)
            last[window][seen] = index
        tint(self.rgb, last, colors)

    def stamp(self, place: Floats, picture: Image) -> None:
        """Put a picture (h, w, 4), whose last channel is its opacity, at a position (3,): all of it at that depth."""
        local = self._to_camera(place[None])
        if local[0, 0] < self._near:
            return
        ((x, y, depth),) = self._project(local)
        window, part = overlap(self.depth.shape, picture.shape, y, x)
        seen = depth <= self.depth[window] * (1 + _BIAS) + _BIAS_M
        opacity = seen * (picture[part][..., 3] / 255)
        self.rgb[window] = blended(self.rgb[window], picture[part][..., :3], opacity)
        self.depth[window][opacity > 0.5] = depth

    def shaded(self, normals: Floats, base_color: Floats) -> Image:
        """Return the camera colours (F, 3) of faces with base colours (3,) or (F, 3), linear RGB."""
        light = self._light
        sun = np.maximum(normals @ light["sun_direction"], 0)[:, None] * light["sun_color"]
        up = (1 + normals[:, 2:]) / 2
        ambient = light["ground_ambient"] + up * (light["sky_ambient"] - light["ground_ambient"])
        values: Floats = 255 * np.minimum(base_color * (sun + ambient), 1) ** (1 / light["gamma"])
        return np.rint(values).astype(np.uint8)

    def _to_camera(self, points: Floats) -> Floats:
        return rotate(self._quat_wxyz, np.asarray(points, float) - self._position, inverse=True)

    def _project(self, local: Floats) -> Floats:
        pixels = self._center - local[:, 1:] / local[:, :1] * self._focal
        return np.concatenate([pixels, local[:, :1]], axis=1)

    def _ahead(self, local: Floats, colors: Image) -> tuple[Floats, Image]:
        """Return the parts of triangles (T, 3, 3), in the camera's frame, beyond the near plane, with their colours."""
        ahead = local[:, :, 0] >= self._near
        count = ahead.sum(axis=1)
        parts, shades = [local[count == 3]], [colors[count == 3]]
        for some in (1, 2):
            # Move the only corner on its side of the plane to the front; the two sides that begin there are cut.
            alone = ahead[count == some] if some == 1 else ~ahead[count == some]
            order = (alone.argmax(axis=1)[:, None] + np.arange(3)) % 3
            a, b, c = np.moveaxis(np.take_along_axis(local[count == some], order[:, :, None], axis=1), 1, 0)
            to_b, to_c = (a + ((self._near - a[:, :1]) / (p - a)[:, :1]) * (p - a) for p in (b, c))
            pieces = [(a, to_b, to_c)] if some == 1 else [(to_b, b, c), (to_b, c, to_c)]
            parts += [np.stack(piece, axis=1) for piece in pieces]
            shades += [colors[count == some]] * len(pieces)
        return np.concatenate(parts), np.concatenate(shades)

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

    def _plot(self, x: Floats, y: Floats, depth: Floats, color: Color, size_px: int, opacity: float) -> None:
        height, width = self.depth.shape
        column, row = np.floor(x).astype(int), np.floor(y).astype(int)
        shifts = np.arange(size_px) - size_px // 2
        column = (column[:, None, None] + shifts).repeat(size_px, axis=1).ravel()
        row = (row[:, None, None] + shifts[:, None]).repeat(size_px, axis=2).ravel()
        depth = depth.repeat(size_px * size_px)
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        at, depth = row[inside] * width + column[inside], depth[inside]
        flat, colors = self.depth.reshape(-1), self.rgb.reshape(-1, 3)
        seen = depth <= flat[at] * (1 + _BIAS) + _BIAS_M
        at, depth = at[seen], depth[seen]
        if opacity < 1:  # glass: the depth of the surface behind it stays
            colors[at] = np.rint(colors[at] + opacity * (np.array(color, float) - colors[at]))
            return
        colors[at] = color
        np.minimum.at(flat, at, depth.astype(np.float32))


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


def _crossing(y: Floats, begin: Floats, end: Floats) -> Floats:
    """Return the x (K,) at which a row at y crosses lines between (x, y, ...) and (x, y, ...), each (K,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        x: Floats = begin[0] + (y - begin[1]) / (end[1] - begin[1]) * (end[0] - begin[0])
    return x


def _beyond(corners: Floats, near: float) -> Floats:
    """Return the unordered corners (V, 3) of the part of a polygon (K, 3), in the camera's frame, beyond a depth."""
    sides = np.roll(corners, -1, axis=0) - corners
    ahead = corners[:, 0] >= near
    cut = ahead != np.roll(ahead, -1)
    crossings = corners[cut] + ((near - corners[cut, 0]) / sides[cut, 0])[:, None] * sides[cut]
    return np.concatenate([corners[ahead], crossings])
