"""Rotations of bodies: vectors between frames, and quaternions to and from roll, pitch and yaw.

A quaternion is (w, x, y, z), unit, body to world. Angles are rad. Roll, pitch and yaw follow ``control="attitude"``:
the body yaws about z, then pitches about its own y, then rolls about its own x, so that the rotation is R_z(yaw)
R_y(pitch) R_x(roll). Every function takes arrays of any leading shape and keeps float32.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep.errors import refuse_masked

__all__ = ["quat_from_rpy", "rotate", "rpy_from_quat", "yaw_of"]

Array: TypeAlias = npt.NDArray[Any]


def rotate(quat_wxyz: Array, vector: Array, *, inverse: bool = False) -> Array:
    """Rotate vectors from the body frame to the world frame.

    Parameters
    ----------
    quat_wxyz
        Unit quaternions, body to world, shape (..., 4).
    vector
        Shape (..., 3), broadcast against ``quat_wxyz``.
    inverse
        Rotate from the world frame to the body frame.
    """
    w, axis = quat_wxyz[..., :1], quat_wxyz[..., 1:]
    if inverse:
        axis = -axis
    twice = 2.0 * np.cross(axis, vector)
    rotated: Array = vector + w * twice + np.cross(axis, twice)
    return rotated.astype(np.result_type(quat_wxyz, vector), copy=False)


def yaw_of(quat_wxyz: Array) -> Array:
    """Return the heading of the body's x axis, (...) rad in [-pi, pi]: 0 along the world's x, pi / 2 along its y.

    Parameters
    ----------
    quat_wxyz
        Unit quaternions, body to world, shape (..., 4).
    """
    refuse_masked("quat_wxyz", quat_wxyz)
    w, x, y, z = np.moveaxis(np.asarray(quat_wxyz, float), -1, 0)
    yaw: Array = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
    return yaw


def rpy_from_quat(quat_wxyz: npt.ArrayLike) -> Array:
    """Return roll, pitch and yaw, (..., 3) rad: roll and yaw in [-pi, pi], pitch in [-pi / 2, pi / 2].

    If the body's x axis points straight up or down, only the sum or difference of roll and yaw is defined; yaw is then
    0.

    Parameters
    ----------
    quat_wxyz
        Unit quaternions, body to world, shape (..., 4).
    """
    quat = _floating(quat_wxyz, 4, "quat_wxyz")
    w, x, y, z = np.moveaxis(quat.astype(float), -1, 0)
    # Half the sum and half the difference of roll and yaw are angles of two vectors. The lengths of these vectors give
    # the pitch without loss of precision near the poles (Bernardes and Viollet, PLOS ONE 17(11), 2022).
    plus, minus = np.arctan2(x + z, w - y), np.arctan2(z - x, w + y)
    pitch = 2 * np.arctan2(np.hypot(w + y, x - z), np.hypot(w - y, x + z)) - np.pi / 2
    is_pole = np.abs(np.abs(pitch) - np.pi / 2) < 1e-7
    yaw = np.where(is_pole, 0.0, plus + minus)
    roll = np.where(is_pole, np.where(pitch > 0, -2 * minus, 2 * plus), plus - minus)
    wrapped = [(angle + np.pi) % (2 * np.pi) - np.pi for angle in (roll, yaw)]
    return np.stack([wrapped[0], pitch, wrapped[1]], axis=-1).astype(quat.dtype)


def quat_from_rpy(rpy: npt.ArrayLike) -> Array:
    """Return the quaternions (..., 4) of roll, pitch and yaw, with w >= 0.

    Parameters
    ----------
    rpy
        Roll, pitch and yaw, shape (..., 3), rad.
    """
    angles = _floating(rpy, 3, "rpy")
    half = np.moveaxis(angles.astype(float), -1, 0) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    quat = np.stack(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ],
        axis=-1,
    )
    return np.where(quat[..., :1] < 0, -quat, quat).astype(angles.dtype)


def _floating(values: npt.ArrayLike, columns: int, name: str) -> Array:
    refuse_masked(name, values)
    array = np.asarray(values)
    if array.ndim == 0 or array.shape[-1] != columns:
        raise ValueError(f"{name}: expected shape (..., {columns}), got shape {array.shape}")
    if array.dtype != np.float32:
        array = array.astype(float)
    return array
