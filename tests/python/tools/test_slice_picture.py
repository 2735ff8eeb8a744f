"""The picture of a fan as a slice: what it draws agrees with what the LiDAR measures."""

import numpy as np
import pytest

from flockstep.pictures.beams import beams_of
from tools.slice_picture import LIDAR, PLACE, Slice, draw


@pytest.fixture(scope="module")
def scan():
    return Slice.scan()


def distances_along(origin, directions, segments):
    """Return the distance (K,) of the first segment (S, 2, 2) that each ray meets, inf if none."""
    p, q = segments[:, 0] - origin, segments[:, 1] - origin
    x, y = directions[:, None, 0], directions[:, None, 1]
    p_side, q_side = x * p[:, 1] - y * p[:, 0], x * q[:, 1] - y * q[:, 0]
    p_along, q_along = x * p[:, 0] + y * p[:, 1], x * q[:, 0] + y * q[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = p_along + (q_along - p_along) * p_side / (p_side - q_side)
    return np.where(((p_side >= 0) != (q_side >= 0)) & (t >= 0), t, np.inf).min(axis=1)


def test_the_hits_are_where_beams_meet_the_slice(scan):
    origin, ends, hit = beams_of(scan.batch, 0)
    ranges = np.where(hit, np.linalg.norm(ends - origin, axis=1), np.inf)
    directions = (ends - origin) / np.linalg.norm(ends - origin, axis=1)[:, None]
    first = distances_along(origin[:2], directions[:, :2], scan.cut)
    first[first > LIDAR.max_range_m] = np.inf
    np.testing.assert_allclose(ranges, first, atol=1e-4)
    assert 20 < hit.sum() < len(hit)


def test_no_box_within_range_and_sector_is_skipped(scan):
    kept = {tuple(segment.ravel()) for segment in scan.cut}
    skipped = np.array([segment for segment in scan.all_cut if tuple(segment.ravel()) not in kept])
    middle = skipped.mean(axis=1) - PLACE[:2]
    angle = (np.arctan2(middle[:, 1], middle[:, 0]) - scan.turns.mean() + np.pi) % (2 * np.pi) - np.pi
    inside = abs(angle) < np.deg2rad(LIDAR.hfov_deg) / 2
    assert np.linalg.norm(middle[inside], axis=1).min() > LIDAR.max_range_m


def test_it_is_drawn(tmp_path, scan):
    draw(tmp_path / "slice.webp", scan)
    assert (tmp_path / "slice.webp").stat().st_size > 50_000
