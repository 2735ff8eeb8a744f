"""The drawn shape of a drone: its mesh; otherwise a quadrotor with arms and rotor discs, or its hull without rotors."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import TypeAlias

import numpy as np

from flockstep._core import BodyConfig, DroneModel, World
from flockstep.drone_mesh import DroneMesh, Floats, Ints
from flockstep.pictures.style import STYLES

_Rgb: TypeAlias = tuple[float, float, float]  # linear, like materials
_Solid: TypeAlias = tuple[Floats, Floats, _Rgb]  # corners (V, 3), indices of triangles (T, 3), and their colour

_FRONT: _Rgb = (0.85, 0.22, 0.05)  # rotors, to show the heading
_HULL: _Rgb = (0.03, 0.09, 0.42)
_PALE = np.array([0.6, 0.7, 0.85])

_DISC_SIDES = 24
DRONE = "drone"  # the body's name


class Body:
    """Shows a drone model as a body.

    Parameters
    ----------
    drone
        The model. With rotors it is a quadrotor with orange front rotors, otherwise its hull.
    mesh
        Shown instead of the model. None: the model.
    style
        A name of `STYLES`.
    """

    def __init__(self, drone: DroneModel, mesh: DroneMesh | None = None, style: str = "bright") -> None:
        self._mesh = _mesh_of(drone, STYLES[style].drone) if mesh is None else mesh
        hull = np.asarray(drone.hull, float)
        #: Points (K, 3) m, body frame, that the hull and the mesh lie between.
        self.corners = hull if mesh is None else np.concatenate([hull, mesh.vertices])
        is_hull = mesh is None and drone.to_dict().get("rotors") is None
        #: Ends of the edges (K, 2, 3) m, body frame, of a hull without a mesh and without rotors.
        self.edges = _edges(self._mesh.vertices, self._mesh.triangles) if is_hull else np.zeros((0, 2, 3))
        self._worlds: dict[bool, World] = {}  # by pale

    def at(self, position: Floats, quat_wxyz: Floats, *, pale: bool = False) -> BodyConfig:
        """Return it at a pose, in pale colours for other drones."""
        if pale not in self._worlds:
            mesh = self._mesh
            colors = 0.35 * mesh.colors + 0.65 * _PALE if pale else mesh.colors
            self._worlds[pale] = DroneMesh(mesh.vertices, mesh.triangles, colors).world()
        return BodyConfig(
            name=DRONE,
            shape="mesh",
            mesh=self._worlds[pale],
            position_m=np.asarray(position, float).tolist(),
            quat_wxyz=np.asarray(quat_wxyz, float).tolist(),
            visibility="visual",
        )


def _mesh_of(drone: DroneModel, colors: Mapping[str, _Rgb]) -> DroneMesh:
    rotors = drone.to_dict().get("rotors")
    if rotors is None:
        solids = [_hull(np.asarray(drone.hull, float))]
    else:
        solids = _quadrotor(np.asarray(rotors["position_m"], float), float(rotors["radius_m"]), colors)
    starts = np.cumsum([0, *(len(corners) for corners, _, _ in solids)])
    return DroneMesh(
        np.concatenate([corners for corners, _, _ in solids]),
        np.concatenate([triangles + start for (_, triangles, _), start in zip(solids, starts, strict=False)]),
        np.concatenate([np.tile(color, (len(triangles), 1)) for _, triangles, color in solids]),
    )


def _quadrotor(hubs: Floats, radius_m: float, colors: Mapping[str, _Rgb]) -> list[_Solid]:
    radius = radius_m if radius_m > 0 else 0.6 * float(np.linalg.norm(hubs[:, :2], axis=1).max())
    angle = np.linspace(0, 2 * np.pi, _DISC_SIDES, endpoint=False)
    disc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    square = radius * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    # Arms are level and begin inside the middle, at any height of the hubs.
    low, high = min(hubs[:, 2].min() - 0.15 * radius, -0.3 * radius), max(hubs[:, 2].max() + 0.1 * radius, 0.3 * radius)
    solids = [_slab(0.6 * square, low, high, colors["middle"])]
    for x, y, z in hubs:
        hub, length = np.array([x, y]), np.hypot(x, y)
        if length > 0.6 * radius:  # otherwise the middle covers it
            across = 0.12 * radius / length * np.array([-y, x])
            arm = np.array([-across, hub - across, hub + across, across])
            solids.append(_slab(arm, z - 0.15 * radius, z + 0.1 * radius, colors["arm"]))
        solids += [
            _slab(hub + 0.1 * square, z - 0.25 * radius, z + 0.4 * radius, colors["arm"]),
            _slab(hub + disc, z + 0.3 * radius, z + 0.36 * radius, _FRONT if x > 0 else colors["rear"]),
        ]
    return solids


def _slab(outline: Floats, low: float, high: float, color: _Rgb) -> _Solid:
    """Return the upright prism over a convex polygon (K, 2) with counter-clockwise corners."""
    count = len(outline)
    corners = np.concatenate([np.insert(outline, 2, z, axis=1) for z in (low, high)])
    here = np.arange(count)
    following = (here + 1) % count
    fan = np.stack([np.zeros(count - 2, int), here[1:-1], here[2:]], axis=1)
    sides = [
        np.stack([here, following, following + count], axis=1),
        np.stack([here, following + count, here + count], 1),
    ]
    return corners, np.concatenate([fan[:, ::-1], fan + count, *sides]), color


def _hull(corners: Floats) -> _Solid:
    """Return the convex hull of points (V, 3): every triangle of them that has all points on one side of its plane."""
    triangles = np.array(list(combinations(range(len(corners)), 3)))
    a, b, c = corners[triangles.T]
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    scale = float(np.ptp(corners, axis=0).max())
    heights = (normals @ corners.T - (normals * a).sum(axis=1)[:, None]) / np.maximum(sizes, 1e-300)[:, None]
    wide = sizes > 1e-6 * scale**2
    below, above = wide & (heights.max(axis=1) <= 1e-5 * scale), wide & (heights.min(axis=1) >= -1e-5 * scale)
    return corners, np.concatenate([triangles[below], triangles[above][:, ::-1]]), _HULL


def _edges(corners: Floats, triangles: Ints) -> Floats:
    """Return the sides of triangles where faces meet at an angle, (K, 2, 3)."""
    a, b, c = corners[triangles].astype(float).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    apart = [
        (side, np.ptp(normals[(sides == side).all(axis=2).any(axis=1)], axis=0).max())
        for side in np.unique(sides.reshape(-1, 2), axis=0)
    ]
    return np.array([corners[side] for side, turn in apart if turn > 1e-3])
