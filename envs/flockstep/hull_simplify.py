"""A convex body with few corners around another one, to collide in place of a mesh."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, product
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.floating[Any]]

_SWEEPS = 20  # maximum number of sweeps; three usually suffice
_WORTH = 1e-4  # fraction of the volume: a sweep that saves less is the last
_MARGIN = 1e-6  # relative enlargement of the body, to cover rounding
_MANY = 50_000  # for more points no hull is computed, and a sample of likely hull corners shapes the body
_NEAR = 0.05  # fraction of the body's size: points deeper inside cannot end up outside
_ROUNDS = 4  # maximum number of rounds in which points outside the body join the sample
_BINS = 24  # bins along each edge of a cube around the points; the farthest point in each bin is sampled
_ROWS = 1 << 14  # points compared with planes at a time


def simplified_hull(points: Floats, most: int) -> npt.NDArray[np.float32]:
    """Return at most ``most`` corners (V, 3) of a small convex body that encloses all points (K, 3).

    If the points' hull has at most that many corners, it is the result. Otherwise the body starts from the outermost
    points, scaled up to enclose the rest. Then each corner moves inward as far as its faces stay outside the points. If
    the hull has very many corners, a sample of them is used, and points that are still outside join the sample.

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
    # A ratio of volumes is invariant under affine maps: in this one a flat body is as round as any.
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
    """Return the minimum width of the hull of points (K, 3), or any width of at least ``enough`` if it is thicker.

    Raises
    ------
    scipy.spatial.QhullError
        The points have no volume.
    """
    from scipy.spatial import ConvexHull

    points = np.asarray(points, float)
    hull = ConvexHull(points if len(points) <= _MANY else _sampled(points))
    # A body is at least as thick as a ball inside it.
    ball = -2 * float(_beyond(hull, hull.points[hull.vertices].mean(axis=0)).max())
    if ball >= enough:
        return ball
    behind = np.max([(-_beyond(hull, rows)).max(axis=0) for rows in _in_rows(points)], axis=0)
    return float((behind + _most_beyond(hull, points)).min())


def _outer(points: Floats) -> Floats:
    """Return the hull corners of points (K, 3), or a superset of them if there are very many points."""
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
    """Return a matrix that scales points (K, 3), relative to their mean, to equal width everywhere, and the mean."""
    middle = points.mean(axis=0)
    values, axes = np.linalg.eigh(np.cov((points - middle).T))
    return axes / np.sqrt(values), middle


def _sampled(points: Floats) -> Floats:
    """Return a few thousand of very many points (K, 3): the farthest from the mean in each direction."""
    to_round, middle = _rounding(points)
    seen = (points - middle) @ to_round
    sizes = np.abs(seen).max(axis=1, keepdims=True)
    bins = np.clip(((seen / np.maximum(sizes, 1e-300) + 1) * (_BINS / 2)).astype(np.int64), 0, _BINS - 1)
    keys = (bins[:, 0] * _BINS + bins[:, 1]) * _BINS + bins[:, 2]
    farthest = np.full(_BINS**3, -1)
    order = (seen**2).sum(axis=1).argsort(kind="stable")
    farthest[keys[order]] = order  # the last, farthest point wins
    sampled: Floats = points[farthest[farthest >= 0]]
    return sampled


def _wrapped(points: Floats, most: int) -> Floats:
    """Return at most ``most`` corners of a small body that encloses all points (K, 3)."""
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
    """Yield points (K, 3) in blocks of few rows, to limit memory use."""
    for begin in range(0, len(points), _ROWS):
        yield points[begin : begin + _ROWS]


def _beyond(hull: Any, points: Floats) -> Floats:
    """Return the distance of each point (K, 3) beyond each face's plane, (K, F)."""
    distances: Floats = points @ hull.equations[:, :3].T + hull.equations[:, 3]
    return distances


def _most_beyond(hull: Any, points: Floats) -> Floats:
    """Return the distance of the farthest of the points (K, 3) beyond each face's plane, (F,)."""
    most: Floats = np.max([_beyond(hull, rows).max(axis=0) for rows in _in_rows(points)], axis=0)
    return most


def _extremes(points: Floats, count: int) -> Floats:
    """Return ``count`` hull corners of points: each is the one farthest beyond the hull of the previous ones."""
    from scipy.spatial import ConvexHull

    # Begin with a tetrahedron: the points farthest from a point, from a line and from a plane.
    first = points[points[:, 0].argmin()]
    kept = [first, points[np.linalg.norm(points - first, axis=1).argmax()]]
    kept.append(points[np.linalg.norm(np.cross(points - first, kept[1] - first), axis=1).argmax()])
    kept.append(points[np.abs((points - first) @ np.cross(kept[1] - first, kept[2] - first)).argmax()])
    while len(kept) < count:
        kept.append(points[_beyond(ConvexHull(np.array(kept)), points).max(axis=1).argmax()])
    return np.array(kept)


def _around(corners: Floats, points: Floats, margin: float = _MARGIN) -> Floats:
    """Return the corners of a body scaled up until it encloses all points, plus a margin."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(corners)
    corners = corners[hull.vertices]
    middle = corners.mean(axis=0)
    factor = 1 + (_most_beyond(hull, points) / -_beyond(hull, middle)).max()
    grown: Floats = middle + max(factor, 1.0) * (1 + margin) * (corners - middle)
    return grown


def _shrunk(corners: Floats, points: Floats) -> Floats:
    """Return the corners of a smaller body that still encloses all points."""
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
    """Return the position of one corner that makes the body smallest while the others stay, or None if there is none.

    The opposite edge of each of the corner's faces defines a plane: rotate the face about that edge until it touches
    the points. The corner has to stay beyond all these planes. The volume is linear in the corner's position, so it is
    smallest at an intersection of three of them.
    """
    faces = np.flatnonzero((hull.simplices == corner).any(axis=1))
    if not len(faces):  # the other corners already enclose it
        return None
    edges = hull.simplices[faces]
    edges = edges[edges != corner].reshape(-1, 2)
    start, end, tip = hull.points[edges[:, 0]], hull.points[edges[:, 1]], hull.points[corner]
    along = (end - start) / np.linalg.norm(end - start, axis=1, keepdims=True)
    outward = hull.equations[faces, :3]
    across = tip - start - ((tip - start) * along).sum(axis=1, keepdims=True) * along
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    # Angle of each point about the edge: 0 in the face and negative below it.
    to_points = points[None] - start[:, None]
    x, y = np.einsum("fkj,fj->fk", to_points, across), np.einsum("fkj,fj->fk", to_points, outward)
    angles = np.where(np.hypot(x, y) > _MARGIN, np.arctan2(y, x), -np.pi)
    touching = np.where(angles > _MARGIN, -np.pi, angles).max(axis=1)[:, None]  # above 0: the far side, after rounding
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
