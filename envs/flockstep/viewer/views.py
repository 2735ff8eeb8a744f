"""What `DroneVectorEnv.render` can show: from above, by the drone's own camera, from behind the drone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, CameraConfig
from flockstep.viewer.third_person_view import ThirdPersonView
from flockstep.viewer.top_view import TopView
from flockstep.viewer.trail import Trail

Image: TypeAlias = npt.NDArray[np.uint8]

NAMES = ("top", "camera", "third_person", "fleet")


class View(Protocol):
    """Makes pictures of the envs of a batch."""

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height, width, 3) uint8, a new array."""


class CameraView:
    """The frames of one camera of the drones, in colour or else grey, as it last took them; black where it is stale."""

    def __init__(self, batch: Batch, name: str) -> None:
        self._camera = batch.camera(name)

    def frame(self, env: int) -> Image:
        """Return the camera's frame of one env, (height_px, width_px, 3) uint8, a new array."""
        config = self._camera.config
        if self._camera.frame_step[env] < 0:
            return np.zeros((config.height_px, config.width_px, 3), np.uint8)
        if "rgb" not in config.outputs:
            return np.repeat(self._camera.grey[env][:, :, None], 3, axis=2)
        rgb = self._camera.rgb[env]
        return np.array(rgb.transpose(1, 2, 0) if config.layout == "chw" else rgb)


def make(name: str, batch: Batch, cameras: Sequence[CameraConfig]) -> tuple[View, Trail | None]:
    """Return one of the views `NAMES`, and the trail it shows, which is to be recorded.

    Raises
    ------
    ValueError
        The view needs a camera that is not there, or not so.
    """
    if name == "top":
        return TopView(batch), None
    if name in ("third_person", "fleet"):
        trail = Trail(batch)
        names = [camera.name for camera in cameras]
        return ThirdPersonView(batch, names, trail, others=name == "fleet"), trail
    if not cameras:
        raise ValueError("render_view: 'camera' needs a camera, and this env has none")
    if not {"rgb", "grey"} & set(cameras[0].outputs):
        raise ValueError(f"render_view: 'camera' needs 'rgb' or 'grey' among its outputs, got {cameras[0].outputs}")
    return CameraView(batch, cameras[0].name), None
