"""A convex body of few corners around another: what collides in place of a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.floating[Any]]

_SWEEPS = 20  # at most; three do mostly
_WORTH = 1e-4  # of the volume: a sweep that saves less is the last
_MARGIN = 1e-6  # of the body: so much larger than it has to be, as numbers are rounded
_MANY = 50_000  # points: of more, no hull is computed, and a sample of those that may be its corners shapes the body
_NEAR = 0.05  # of the body's size: what is farther inside does not come to stick out
_ROUNDS = 4  # at most, in which points that stick out of the body join the sample
_BINS = 24  # along each edge of a cube around the points: the farthest point in each bin is sampled
_ROWS = 1 << 14  # points that are compared with planes at a time


def simplified_hull(points: Floats, most: int) -> npt.NDArray[np.float32]:
    """Return at most so many corners (V, 3) of a convex body that holds all points (K, 3) and is little larger.

    Where their hull has no more corners, it is that. Else it begins as the points that stick out most, blown up around
    the rest; then corner by corner moves in, as far as the faces around it stay outside. If the hull has very many
    corners, this is done with a sample of them, which the points that still stick out join.

    Raises
    ------
    scipy.spatial.QhullError
        The points have no volume.
    """
    from scipy.spatial import ConvexHull

    points = np.asarray(points, float)
    outer = _outer(points)
    if len(outer) <= most:
        return outer.astype(np.float32)
    # A ratio of volumes is the same in every affine picture: in this one a flat body is as round as any.
    to_round, middle = _rounding(outer)
    seen = (outer - middle) @ to_round
    bodies = [_wrapped(seen, most) @ np.linalg.inv(to_round) + middle]
    if most >= 8:
        low, high = outer.min(axis=0), outer.max(axis=0)
        box = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
        bodies.append(_around(box, outer))
    least = min(bodies, key=lambda corners: float(ConvexHull(corners).volume))
    margin = _MARGIN
    held = outer if len(outer) <= _MANY else points
    rounded: npt.NDArray[np.float32] = least.astype(np.float32)
    while _most_beyond(ConvexHull(rounded), held).max() > 0:  # float32 is coarse far from 0
        least, margin = _around(least, outer, margin), 2 * margin
        rounded = least.astype(np.float32)
    return rounded


def thickness(points: Floats, enough: float) -> float:
    """Return the least width of the hull of points (K, 3), or some width from ``enough`` on if it is no thinner.

    Raises
    ------
    scipy.spatial.QhullError
        The points have no volume.
    """
    from scipy.spatial import ConvexHull

    points = np.asarray(points, float)
    hull = ConvexHull(points if len(points) <= _MANY else _sampled(points))
    # A body is nowhere thinner than a ball inside it.
    ball = -2 * float(_beyond(hull, hull.points[hull.vertices].mean(axis=0)).max())
    if ball >= enough:
        return ball
    behind = np.max([(-_beyond(hull, rows)).max(axis=0) for rows in _in_rows(points)], axis=0)
    return float((behind + _most_beyond(hull, points)).min())


def _outer(points: Floats) -> Floats:
    """Return the corners of the hull of points (K, 3); if there are very many, points among which they all are."""
    from scipy.spatial import ConvexHull

    if len(points) > _MANY:
        to_round, middle = _rounding(points)
        seen = (points - middle) @ to_round
        directions = np.array([d for d in product((-1, 0, 1), repeat=3) if any(d)], float)
        extremes = seen[np.unique([(seen @ direction).argmax() for direction in directions])]
        hull = ConvexHull(extremes)
        is_outside = [(_beyond(hull, rows) > _MARGIN * _MARGIN).any(axis=1) for rows in _in_rows(seen)]
        candidates = np.concatenate(is_outside)
        candidates[[int((seen @ direction).argmax()) for direction in directions]] = True
        points = points[candidates]
    if len(points) > _MANY:
        return points
    outer: Floats = points[ConvexHull(points).vertices]
    return outer


def _rounding(points: Floats) -> tuple[Floats, Floats]:
    """Return a matrix that makes points (K, 3), from their middle, as wide in all directions, and this middle."""
    middle = points.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov((points - middle).T))
    return axes / np.sqrt(values), middle


def _sampled(points: Floats) -> Floats:
    """Return some thousand of very many points (K, 3): in every direction from their middle the farthest."""
    to_round, middle = _rounding(points)
    seen = (points - middle) @ to_round
    sizes = np.abs(seen).max(axis=1, keepdims=True)
    bins = np.clip(((seen / np.maximum(sizes, 1e-300) + 1) * (_BINS / 2)).astype(np.int64), 0, _BINS - 1)
    keys = (bins[:, 0] * _BINS + bins[:, 1]) * _BINS + bins[:, 2]
    farthest = np.full(_BINS**3, -1)
    order = (seen**2).sum(axis=1).argsort(kind="stable")
    farthest[keys[order]] = order  # the last one stays
    sampled: Floats = points[farthest[farthest >= 0]]
    return sampled


def _wrapped(points: Floats, most: int) -> Floats:
    """Return at most so many corners of a small body that holds all points (K, 3)."""
    from scipy.spatial import ConvexHull

    if len(points) <= _MANY:
        return _around(_shrunk(_around(_extremes(points, most), points), points), points)
    sample = _sampled(points)
    body, near = _extremes(sample, most), points
    for _ in range(_ROUNDS):
        body = _around(_shrunk(_around(body, sample), sample), sample)
        hull = ConvexHull(body)
        beyond = np.concatenate([_beyond(hull, rows).max(axis=1) for rows in _in_rows(near)])
        if beyond.max() <= _MARGIN:
            break
        near = near[beyond > -_NEAR]
        sample = np.concatenate([sample, *(rows[_beyond(hull, rows).argmax(axis=0)] for rows in _in_rows(near))])
    return _around(body, points)


def _in_rows(points: Floats) -> Iterator[Floats]:
    """Return points (K, 3) in pieces of few rows, so that what is computed of them takes little memory."""
    for begin in range(0, len(points), _ROWS):
        yield points[begin : begin + _ROWS]


def _beyond(hull: Any, points: Floats) -> Floats:
    """Return (K, F) how far points (K, 3) are beyond each face's plane."""
    distances: Floats = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    return distances


def _most_beyond(hull: Any, points: Floats) -> Floats:
    """Return (F,) how far the farthest of points (K, 3) is beyond each face's plane."""
    most: Floats = np.max([_beyond(hull, rows).max(axis=0) for rows in _in_rows(points)], axis=0)
    return most


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
    factor = 1 + (_most_beyond(hull, points) / -_beyond(hull, middle)).max()
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
