"""The mesh of a quadrotor, made from the numbers of its file, and the faces and edges of its hull."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import DroneModel

Floats: TypeAlias = npt.NDArray[np.floating[Any]]
Ints: TypeAlias = npt.NDArray[np.integer[Any]]
Rgb: TypeAlias = tuple[float, float, float]  # linear, like materials
Solid: TypeAlias = tuple[Floats, Ints, Rgb]  # corners (V, 3), indices of triangles (T, 3), and their colour

FRONT: Rgb = (0.85, 0.22, 0.05)  # propellers, to show the heading
#: Colours of the other parts.
COLORS: Mapping[str, Rgb] = {"middle": (0.05, 0.06, 0.08), "arm": (0.12, 0.13, 0.16), "rear": (0.08, 0.18, 0.5)}

_TURNS = np.radians(np.arange(0, 180, 3))  # of a propeller that stands still
#: Outline of one blade: distance from the hub and half its chord there, in radii.
_BLADE = np.array([[0.04, 0.035], [0.16, 0.08], [0.4, 0.085], [0.8, 0.055], [0.96, 0.035], [0.998, 0.012]])


def quadrotor(drone: DroneModel, colors: Mapping[str, Rgb] = COLORS, *, propellers: bool = True) -> list[Solid]:
    """Return body, legs, arms, motors and, unless left out, propellers of a model with rotors.

    The propellers stand still, turned so that the hull encloses them if it can: some hulls are narrower than the discs.
    """
    hubs, spins, radius = rotors_of(drone)
    reach = float(np.linalg.norm(hubs[:, :2], axis=1).max())
    hull = np.asarray(drone.hull, float)
    normals, offsets = _planes(hull)
    level = float(np.median(hubs[:, 2])) - 0.13 * radius  # of the arms, below the propellers
    solids = _body(0.36 * reach, level, hull[:, 2].min(), hull[:, 2].max(), 0.05 * radius, colors)
    for hub, spin in zip(hubs, spins, strict=True):
        foot = hub - [0, 0, 0.13 * radius]
        middle = np.array([0.0, 0.0, level])
        if np.linalg.norm(foot - middle) > 0.1 * radius:
            solids.append(tube(middle, foot, 0.045 * radius, colors["arm"]))
        for low, high, wide in ((-0.17, -0.03, 0.12), (-0.03, 0.05, 0.045)):  # the motor, and what holds the propeller
            outline = hub[:2] + wide * radius * _polygon(16)
            solids.append(prism(outline, hub[2] + low * radius, hub[2] + high * radius, colors["arm"]))
        if not propellers:
            continue
        turns = [_propeller(radius, turn, spin) + hub for turn in _TURNS]
        beyond = [float((corners @ normals.T - offsets).max()) for corners in turns]
        both = np.split(turns[int(np.argmin(beyond))], 2)
        solids += [(blade, _sides(len(_BLADE) * 2), FRONT if hub[0] > 0 else colors["rear"]) for blade in both]
    return solids


def rotors_of(drone: DroneModel) -> tuple[Floats, list[str], float]:
    """Return places (K, 3) m, spins and the drawn radius (m) of the rotors of a model with rotors."""
    rotors = drone.to_dict()["rotors"]
    hubs = np.asarray(rotors["position_m"], float)
    radius = float(rotors["radius_m"]) or 0.6 * float(np.linalg.norm(hubs[:, :2], axis=1).max())
    return hubs, list(rotors["spin"]), radius


def _body(size: float, level: float, low: float, high: float, gap: float, colors: Mapping[str, Rgb]) -> list[Solid]:
    """Return plates, canopy, battery, antenna and legs, between the heights of the hull."""
    plate = size * _polygon(8)
    top, bottom = min(level + 1.3 * gap, high), max(level - 1.3 * gap, low)
    roof = top + min(0.62 * (high - top), 0.5 * size)
    floor = bottom - min(0.4 * (bottom - low), 0.4 * size)
    wide, narrow = size * np.array([0.72, 0.46]), size * np.array([0.85, 0.34])
    solids = [
        prism(plate, level + gap, top, colors["middle"]),
        prism(plate, bottom, level - gap, colors["middle"]),
        prism(wide * _polygon(8), top, roof, colors["rear"], 0.6),
        prism(narrow * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), floor, bottom, colors["middle"]),
    ]
    thin = min(0.04 * size, 0.1 * (high - low))
    behind, tip = np.array([-0.78 * size, 0]), top + 0.85 * (high - top)
    solids += [
        tube([*behind, top], [*behind, tip], 0.6 * thin, colors["arm"]),
        prism(behind + 0.14 * size * _polygon(16), tip, tip + 0.12 * (high - top), colors["arm"]),
    ]
    for side in (-1, 1):
        y, z = 0.85 * side * size, low + 1.2 * thin
        solids.append(tube([-1.05 * size, y, z], [1.05 * size, y, z], thin, colors["arm"]))
        for x in (-0.5 * size, 0.5 * size):
            solids.append(tube([x, 0.45 * side * size, bottom], [x, y, z], 0.8 * thin, colors["arm"]))
    return solids


def _polygon(sides: int) -> Floats:
    """Return the corners (K, 2) of a regular polygon with sides across the axes, counter-clockwise, at distance 1."""
    angle = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _propeller(radius: float, turn: float, spin: str) -> Floats:
    """Return the corners of two blades, one after the other, around the hub."""
    outline = np.concatenate([_BLADE * [1, -1], _BLADE[::-1]]) * radius
    pitch = 0.2 * (1 if spin == "cw" else -1)  # the edge that leads is higher
    layers = [np.insert(outline, 2, pitch * outline[:, 1] + z * radius, axis=1) for z in (-0.008, 0.008)]
    blade = np.concatenate(layers)
    return np.concatenate([blade @ _turned(turn + half).T for half in (0.0, np.pi)])


def _turned(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def prism(outline: Floats, low: float, high: float, color: Rgb, top: float = 1.0) -> Solid:
    """Return the upright prism over a convex polygon (K, 2) with counter-clockwise corners, its top scaled."""
    upper = outline.mean(axis=0) + top * (outline - outline.mean(axis=0))
    corners = np.concatenate([np.insert(outline, 2, low, axis=1), np.insert(upper, 2, high, axis=1)])
    return corners, _sides(len(outline)), color


def _sides(count: int) -> Ints:
    """Return the triangles of a prism with this number of corners below, and as many above."""
    here = np.arange(count)
    following = (here + 1) % count
    fan = np.stack([np.zeros(count - 2, int), here[1:-1], here[2:]], axis=1)
    sides = [
        np.stack([here, following, following + count], axis=1),
        np.stack([here, following + count, here + count], 1),
    ]
    return np.concatenate([fan[:, ::-1], fan + count, *sides])


def tube(start: npt.ArrayLike, end: npt.ArrayLike, radius: float, color: Rgb) -> Solid:
    """Return a tube with eight sides."""
    begin, along = np.asarray(start, float), np.subtract(end, start)
    length = float(np.linalg.norm(along))
    axis = along / length
    across = np.cross(axis, [0, 0, 1.0] if abs(axis[2]) < 0.9 else [1.0, 0, 0])
    across /= np.linalg.norm(across)
    corners, triangles, _ = prism(radius * _polygon(8), 0.0, length, color)
    return begin + corners @ np.stack([across, np.cross(axis, across), axis]), triangles, color


def hull_faces(corners: Floats) -> Ints:
    """Return the triangles of a convex hull of points (V, 3): all that have every point on one side of their plane."""
    triangles = np.array(list(combinations(range(len(corners)), 3)))
    a, b, c = corners[triangles.T]
    normals = np.cross(b - a, c - a)
    sizes = np.linalg.norm(normals, axis=1)
    scale = float(np.ptp(corners, axis=0).max())
    heights = (normals @ corners.T - (normals * a).sum(axis=1)[:, None]) / np.maximum(sizes, 1e-300)[:, None]
    wide = sizes > 1e-6 * scale**2
    below, above = wide & (heights.max(axis=1) <= 1e-5 * scale), wide & (heights.min(axis=1) >= -1e-5 * scale)
    return np.concatenate([triangles[below], triangles[above][:, ::-1]])


def _planes(corners: Floats) -> tuple[Floats, Floats]:
    """Return the outward normals (K, 3) and offsets (K,) of a hull's planes: n @ p <= offset inside."""
    a, b, c = corners[hull_faces(corners)].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return normals, (normals * a).sum(axis=1)


def hull_edges(corners: Floats) -> Floats:
    """Return the edges (K, 2, 3) of a convex hull, where faces meet at an angle."""
    triangles = hull_faces(corners)
    a, b, c = corners[triangles].astype(float).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    apart = [
        (side, np.ptp(normals[(sides == side).all(axis=2).any(axis=1)], axis=0).max())
        for side in np.unique(sides.reshape(-1, 2), axis=0)
    ]
    return np.array([corners[side] for side, turn in apart if turn > 1e-3])
