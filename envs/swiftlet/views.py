"""What `DroneVectorEnv.render` can show: from above, by the drone's own camera, from behind the drone."""

from __future__ import annotations

from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from swiftlet._core import Batch, CameraConfig, DroneModel, LidarConfig
from swiftlet.third_person_view import ThirdPersonView
from swiftlet.top_view import TopView
from swiftlet.trail import Trail

Image: TypeAlias = npt.NDArray[np.uint8]

NAMES = ("top", "camera", "third_person")


class View(Protocol):
    """Makes pictures of the envs of a batch."""

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height, width, 3) uint8, a new array."""


class CameraView:
    """The frames of one camera of the drones, in colour or else grey, as it last took them."""

    def __init__(self, batch: Batch, name: str) -> None:
        self._camera = batch.camera(name)

    def frame(self, env: int) -> Image:
        """Return the camera's frame of one env, (height_px, width_px, 3) uint8, a new array."""
        config = self._camera.config
        if "rgb" not in config.outputs:
            return np.repeat(self._camera.grey[env][:, :, None], 3, axis=2)
        rgb = self._camera.rgb[env]
        return np.array(rgb.transpose(1, 2, 0) if config.layout == "chw" else rgb)


def make(
    name: str, batch: Batch, drone: DroneModel | None, lidar: LidarConfig | None, camera: CameraConfig | None
) -> tuple[View, Trail | None]:
    """Return one of the views `NAMES`, and the trail it shows, which is to be recorded.

    Raises
    ------
    ValueError
        The view needs a camera that is not there, or not so.
    """
    if name == "top":
        return TopView(batch, drone, lidar), None
    if name == "third_person":
        trail = Trail(batch)
        return ThirdPersonView(batch, drone, lidar, [] if camera is None else [camera.name], trail), trail
    if camera is None:
        raise ValueError("render_view: 'camera' needs a camera, and this env has none")
    if not {"rgb", "grey"} & set(camera.outputs):
        raise ValueError(f"render_view: 'camera' needs 'rgb' or 'grey' among its outputs, got {camera.outputs}")
    return CameraView(batch, camera.name), None
