"""The drawn shape of a drone: its mesh; otherwise a quadrotor with arms and rotor discs, or its hull without rotors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import DroneModel
from flockstep.drone_mesh import DroneMesh
from flockstep.pictures.depth_canvas import Color, DepthCanvas, Floats
from flockstep.rotations import rotate

_Rgb: TypeAlias = tuple[float, float, float]  # linear, like materials

_MIDDLE: _Rgb = (0.05, 0.06, 0.08)
_ARM: _Rgb = (0.12, 0.13, 0.16)
_FRONT: _Rgb = (0.85, 0.22, 0.05)  # rotors, to show the heading
_REAR: _Rgb = (0.08, 0.18, 0.5)
_HULL: _Rgb = (0.03, 0.09, 0.42)
_PALE = np.array([0.6, 0.7, 0.85])
_EDGE: Color = (20, 40, 110)

_DISC_SIDES = 24


@dataclass
class _Part:
    """A convex body in one colour: the points p with normals (F, 3) . p <= offsets (F,), and its corners (V, 3)."""

    normals: Floats
    offsets: Floats
    corners: Floats
    color: _Rgb


class Body:
    """Draws a drone model.

    Parameters
    ----------
    drone
        The model. With rotors it is drawn as a quadrotor with orange front rotors, otherwise as its hull with edges.
    mesh
        Drawn instead of the model. None: the model.
    """

    def __init__(self, drone: DroneModel, mesh: DroneMesh | None = None) -> None:
        rotors = drone.to_dict().get("rotors")
        self._edges = np.empty((0, 2, 3))
        self._mesh = mesh
        self._parts: list[_Part] = []
        if mesh is not None:
            self._corners = mesh.vertices[mesh.triangles].astype(float)
            normals = np.cross(self._corners[:, 1] - self._corners[:, 0], self._corners[:, 2] - self._corners[:, 0])
            self._normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        elif rotors is None:
            corners = np.asarray(drone.hull, float)
            normals, offsets = _faces(corners)
            self._parts = [_Part(normals, offsets, corners, _HULL)]
            self._edges = corners[_edges(corners, normals, offsets)]
        else:
            self._parts = _quadrotor(np.asarray(rotors["position_m"], float), float(rotors["radius_m"]))

    def draw(
        self, canvas: DepthCanvas, position: Floats, quat_wxyz: Floats, *, pale: bool = False, line_px: int = 1
    ) -> None:
        """Draw it at a pose, in pale colours for other drones."""
        axes = rotate(quat_wxyz, np.eye(3))
        if self._mesh is not None:
            shades = canvas.shaded(self._normals @ axes, _tinted(self._mesh.colors, pale))
            canvas.triangles(position + self._corners @ axes, shades)
            return
        for part in self._parts:
            normals = part.normals @ axes
            shades = canvas.shaded(normals, _tinted(np.array(part.color), pale))
            canvas.solid(normals, part.offsets + normals @ position, position + part.corners @ axes, shades)
        starts, ends = np.moveaxis(position + self._edges @ axes, 1, 0)
        canvas.lines(starts, ends, _EDGE, width_px=line_px)


def _tinted(color: Floats, pale: bool) -> Floats:
    return 0.35 * color + 0.65 * _PALE if pale else color


def _quadrotor(hubs: Floats, radius_m: float) -> list[_Part]:
    radius = radius_m if radius_m > 0 else 0.6 * float(np.linalg.norm(hubs[:, :2], axis=1).max())
    angle = np.linspace(0, 2 * np.pi, _DISC_SIDES, endpoint=False)
    disc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    square = radius * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    # Arms are level and begin inside the middle, at any height of the hubs.
    low, high = min(hubs[:, 2].min() - 0.15 * radius, -0.3 * radius), max(hubs[:, 2].max() + 0.1 * radius, 0.3 * radius)
    parts = [_slab(0.6 * square, low, high, _MIDDLE)]
    for x, y, z in hubs:
        hub, length = np.array([x, y]), np.hypot(x, y)
        if length > 0.6 * radius:  # otherwise the middle covers it
            across = 0.12 * radius / length * np.array([-y, x])
            arm = np.array([-across, hub - across, hub + across, across])
            parts.append(_slab(arm, z - 0.15 * radius, z + 0.1 * radius, _ARM))
        parts += [
            _slab(hub + 0.1 * square, z - 0.25 * radius, z + 0.4 * radius, _ARM),
            _slab(hub + disc, z + 0.3 * radius, z + 0.36 * radius, _FRONT if x > 0 else _REAR),
        ]
    return parts


def _slab(outline: Floats, low: float, high: float, color: _Rgb) -> _Part:
    """Return the upright prism over a convex polygon (K, 2) with counter-clockwise corners."""
    sides = np.roll(outline, -1, axis=0) - outline
    normals = np.stack([sides[:, 1], -sides[:, 0]], axis=1) / np.linalg.norm(sides, axis=1, keepdims=True)
    offsets = (normals * outline).sum(axis=1)
    corners = np.concatenate([np.insert(outline, 2, z, axis=1) for z in (low, high)])
    normals = np.concatenate([np.insert(normals, 2, 0, axis=1), [[0, 0, 1], [0, 0, -1]]])
    return _Part(normals, np.concatenate([offsets, [high, -low]]), corners, color)


def _faces(corners: Floats) -> tuple[Floats, Floats]:
    """Return the half-spaces normals (F, 3) . p <= offsets (F,) that bound the convex hull of points (V, 3)."""
    a, b, c = corners[np.array(list(combinations(range(len(corners)), 3))).T]
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    scale = float(np.ptp(corners, axis=0).max())
    kept = sizes > 1e-6 * scale**2
    normals, a = normals[kept] / sizes[kept, None], a[kept]
    offsets = np.einsum("ij,ij->i", normals, a)
    beyond = normals @ corners.T - offsets[:, None]
    outer = beyond.max(axis=1) <= 1e-5 * scale
    inner = beyond.min(axis=1) >= -1e-5 * scale  # the plane of a face, oriented inward
    planes = np.concatenate(
        [
            np.insert(normals[outer], 3, offsets[outer], axis=1),
            np.insert(-normals[inner], 3, -offsets[inner], axis=1),
        ]
    )
    _, first = np.unique(np.round(planes, 4) + 0.0, axis=0, return_index=True)
    return planes[first, :3], planes[first, 3]


def _edges(corners: Floats, normals: Floats, offsets: Floats) -> npt.NDArray[np.intp]:
    """Return the edges of a convex body as pairs (E, 2) of its corners."""
    on_face = (np.abs(corners @ normals.T - offsets) <= 1e-4 * np.ptp(corners, axis=0).max()).astype(int)
    return np.argwhere(np.triu(on_face @ on_face.T >= 2, 1))
