"""A convex body of few corners around another: what collides in place of a mesh."""

from __future__ import annotations

from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.floating[Any]]

_SWEEPS = 20  # at most; three do mostly
_WORTH = 1e-4  # of the volume: a sweep that saves less is the last
_MARGIN = 1e-6  # of the body: so much larger than it has to be, as numbers are rounded


def few_corners(points: Floats, most: int) -> npt.NDArray[np.float32]:
    """Return at most so many corners (V, 3) of a convex body that holds all points (K, 3) and is little larger.

    Where their hull has no more corners, it is that. Else it begins as the points that stick out most, blown up around
    the rest; then corner by corner moves in, as far as the faces around it stay outside.

    Raises
    ------
    scipy.spatial.QhullError
        The points have no volume.
    """
    from scipy.spatial import ConvexHull

    points = np.asarray(points, float)
    outer: Floats = points[ConvexHull(points).vertices]
    if len(outer) <= most:
        return outer.astype(np.float32)
    # A ratio of volumes is the same in every affine picture: in this one a flat body is as round as any.
    middle = outer.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov((outer - middle).T))
    to_round = axes / np.sqrt(values)
    seen = (outer - middle) @ to_round
    bodies = [_around(_shrunk(_around(_extremes(seen, most), seen), seen), seen) @ np.linalg.inv(to_round) + middle]
    if most >= 8:
        low, high = outer.min(axis=0), outer.max(axis=0)
        box = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
        bodies.append(_around(box, outer))
    least = min(bodies, key=lambda corners: float(ConvexHull(corners).volume))
    margin = _MARGIN
    rounded: npt.NDArray[np.float32] = least.astype(np.float32)
    while _beyond(ConvexHull(rounded), outer).max() > 0:  # float32 is coarse far from 0
        least, margin = _around(least, outer, margin), 2 * margin
        rounded = least.astype(np.float32)
    return rounded


def _beyond(hull: Any, points: Floats) -> Floats:
    """Return (K, F) how far points (K, 3) are beyond each face's plane."""
    distances: Floats = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    return distances


def _extremes(points: Floats, count: int) -> Floats:
    """Return so many corners of the hull of points: each the one farthest beyond the hull of those before."""
    from scipy.spatial import ConvexHull

    # A tetrahedron to begin with: the farthest from a point, from a line, from a plane.
    first = points[points[:, 0].argmin()]
    kept = [first, points[np.linalg.norm(points - first, axis=1).argmax()]]
    kept.append(points[np.linalg.norm(np.cross(points - first, kept[1] - first), axis=1).argmax()])
    kept.append(points[np.abs((points - first) @ np.cross(kept[1] - first, kept[2] - first)).argmax()])
    while len(kept) < count:
        kept.append(points[_beyond(ConvexHull(np.array(kept)), points).max(axis=1).argmax()])
    return np.array(kept)


def _around(corners: Floats, points: Floats, margin: float = _MARGIN) -> Floats:
    """Return the corners of a body blown up until it holds all points, and by a margin more."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    corners = corners[hull.vertices]
    middle = corners.mean(axis=0)
    factor = 1 + (_beyond(hull, points) / -_beyond(hull, middle)).max()
    grown: Floats = middle + max(factor, 1.0) * (1 + margin) * (corners - middle)
    return grown


def _shrunk(corners: Floats, points: Floats) -> Floats:
    """Return the corners of a smaller body that holds all points, too."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    inside = points.mean(axis=0)
    for _ in range(_SWEEPS):
        before = hull.volume
        for corner in range(len(corners)):
            place = _moved_in(hull, corner, points, inside)
            if place is None:
                continue
            changed = np.array(hull.points)
            changed[corner] = place
            tried = ConvexHull(changed)
            if tried.volume < hull.volume and _beyond(tried, points).max() < _MARGIN:
                hull = tried
        if hull.volume > before * (1 - _WORTH):
            break
    shrunk: Floats = hull.points[hull.vertices]
    return shrunk


def _moved_in(hull: Any, corner: int, points: Floats, inside: Floats) -> Floats | None:
    """Return where a corner would make the body smallest with all others as they are, or None if nowhere.

    The corner has to stay beyond a plane through each edge across its faces: the one that turns about that edge until
    it touches the points. The volume is linear in the corner's place, so it is least where three of these planes meet.
    """
    faces = np.flatnonzero((hull.simplices == corner).any(axis=1))
    if not len(faces):  # it is within the others by now
        return None
    edges = hull.simplices[faces]
    edges = edges[edges != corner].reshape(-1, 2)
    start, end, tip = hull.points[edges[:, 0]], hull.points[edges[:, 1]], hull.points[corner]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    outward = hull.equations[faces, :3]
    across = tip - start - ((tip - start) * along).sum(axis=1, keepdims=True) * along
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    # Of each point the angle about the edge, 0 in the face and negative below it.
    to_points = points[None] - start[:, None]
    x, y = np.einsum("fkj,fj->fk", to_points, across), np.einsum("fkj,fj->fk", to_points, outward)
    angles = np.where(np.hypot(x, y) > _MARGIN, np.arctan2(y, x), -np.pi)
    touching = np.where(angles > _MARGIN, -np.pi, angles).max(axis=1)[:, None]  # above 0: the far side, rounded
    normals = np.cos(touching) * outward - np.sin(touching) * across
    offsets = (normals * start).sum(axis=1)

    threes = np.array(list(combinations(range(len(faces)), 3)))
    threes = threes[np.abs(np.linalg.det(normals[threes])) > _MARGIN]
    places = np.linalg.solve(normals[threes], offsets[threes][:, :, None])[:, :, 0]
    places = places[(places @ normals.T >= offsets - _MARGIN * _MARGIN).all(axis=1)]
    if not len(places):
        return None
    growth = np.cross(start - inside, end - inside)
    growth *= np.sign((growth * (tip - inside)).sum(axis=1, keepdims=True))
    least: Floats = places[(places @ growth.sum(axis=0)).argmin()]
    return least
