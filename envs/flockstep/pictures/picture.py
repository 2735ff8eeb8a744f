"""One picture of a world from any viewpoint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, BodyConfig, Camera, CameraConfig, World
from flockstep.scenes import WorldLike, load_one

Array: TypeAlias = npt.NDArray[Any]

FARTHEST_M = 1e6  # maximum range of a camera


def render(
    world: WorldLike,
    position: npt.ArrayLike,
    quat_wxyz: npt.ArrayLike | None = None,
    *,
    look_at: npt.ArrayLike | None = None,
    camera: CameraConfig | None = None,
    bodies: Sequence[BodyConfig] | None = None,
) -> dict[str, Array]:
    """Take a picture of a world. For many pictures make a `Batch` with cameras, which takes them all at once.

    Parameters
    ----------
    world
        A `World`, or the name or path of one. It is shown without drones.
    position, quat_wxyz
        (3,) m and (4,): the pose of a drone that carries the camera. By default it faces +x.
    look_at
        (3,) m, instead of ``quat_wxyz``: a point to face, with the horizon level.
    camera
        Default: 640 x 480 pixels over 90 degrees, ``rgb``, with practically unlimited range.
    bodies
        The bodies to show. Default: those of the world, as at the start of an episode.

    Returns
    -------
    An array for each of the camera's outputs, as in `Camera` of one drone: ``picture["rgb"]`` is (H, W, 3).

    Raises
    ------
    ValueError
        Both ``quat_wxyz`` and ``look_at`` are given, or the numbers are not a valid pose.
    """
    if look_at is not None:
        if quat_wxyz is not None:
            raise ValueError("look_at: expected look_at or quat_wxyz, got both")
        quat_wxyz = facing(position, look_at)
    config = CameraConfig(far_m=FARTHEST_M) if camera is None else camera
    taken = take(load_one(world), position, quat_wxyz, config, bodies)
    return {output: getattr(taken, output)[0].copy() for output in config.outputs}


def take(
    world: World,
    position: npt.ArrayLike,
    quat_wxyz: npt.ArrayLike | None,
    camera: CameraConfig,
    bodies: Sequence[BodyConfig] | None,
) -> Camera:
    """Take a picture as `render` does; return the camera with its images."""
    shown = world if bodies is None else without_bodies(world)
    return take_by(Batch(shown, cameras=[camera], bodies=list(bodies or ())), position, quat_wxyz)


def take_by(batch: Batch, position: npt.ArrayLike, quat_wxyz: npt.ArrayLike | None) -> Camera:
    """Take a picture by the only camera of a batch, which a drone carries to this pose."""
    batch.set_pose(_row("position", position, 3), None if quat_wxyz is None else _row("quat_wxyz", quat_wxyz, 4))
    batch.capture()
    return batch.camera()


def without_bodies(world: World) -> World:
    """Return a world without its bodies; the same object if it has none."""
    return world.with_bodies(None) if world.bodies else world


def facing(position: npt.ArrayLike, target: npt.ArrayLike) -> npt.NDArray[np.float32]:
    """Return the quaternion (4,) that turns +x from a position (3,) towards a target (3,) and keeps y level."""
    x, y, z = _row("look_at", target, 3)[0].astype(float) - _row("position", position, 3)[0].astype(float)
    if x == y == z == 0:
        raise ValueError("look_at: expected a point other than position")
    yaw, pitch = np.arctan2(y, x) / 2, -np.arctan2(z, np.hypot(x, y)) / 2
    # First a rotation about y, then one about z.
    c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
    return np.array([c * cp, -s * sp, c * sp, s * cp], np.float32)


def _row(field: str, value: npt.ArrayLike, size: int) -> npt.NDArray[np.float32]:
    array = np.asarray(value, np.float32)
    if array.shape != (size,):
        raise ValueError(f"{field}: expected shape ({size},), got {array.shape}")
    return array[None]
