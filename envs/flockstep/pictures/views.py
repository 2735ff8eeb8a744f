"""Views of `DroneVectorEnv.render`: from above, by the drone's own camera, from behind it, from a fixed place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, CameraConfig, World
from flockstep.drone_mesh import DroneMesh
from flockstep.errors import did_you_mean
from flockstep.pictures.choice import Choice
from flockstep.pictures.drawing import Overlay
from flockstep.pictures.flight_overlay import OVERLAYS
from flockstep.pictures.lines import Trail
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.pictures.top_view import TopView
from flockstep.task import MARKERS

Image: TypeAlias = npt.NDArray[np.uint8]


class View(Protocol):
    """Makes pictures of the envs of a batch."""

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height, width, 3) uint8, a new array."""


class CameraView:
    """The last frames of one camera of the drones, in colour or otherwise grey, with lines; black if stale.

    With a size (width, height) they are scaled to fit, pixel by pixel, on black.
    """

    def __init__(self, batch: Batch, name: str, size_px: tuple[int, int] | None = None) -> None:
        self._batch = batch
        self._camera = batch.camera(name)
        self._size_px = size_px

    def frame(self, env: int) -> Image:
        """Return the camera's frame of one env, (height, width, 3) uint8, a new array."""
        config = self._camera.config
        if self._camera.frame_step[env] < 0:
            width, height = config.image_size_px
            taken = np.zeros((height, width, 3), np.uint8)
        else:
            taken = self._batch.picture(env, config.name)
        return taken if self._size_px is None else _fitted(taken, *self._size_px)


def _fitted(image: Image, width: int, height: int) -> Image:
    rows, columns, _ = image.shape
    scale = min(width / columns, height / rows)
    down = np.minimum(((np.arange(max(round(rows * scale), 1)) + 0.5) / scale).astype(int), rows - 1)
    right = np.minimum(((np.arange(max(round(columns * scale), 1)) + 0.5) / scale).astype(int), columns - 1)
    whole = np.zeros((height, width, 3), np.uint8)
    top, left = (height - len(down)) // 2, (width - len(right)) // 2
    whole[top : top + len(down), left : left + len(right)] = image[np.ix_(down, right)]
    return whole


def make(
    choice: Choice,
    batch: Batch,
    cameras: Sequence[CameraConfig],
    overlay: Overlay | str = "",
    mesh: DroneMesh | World | None = None,
) -> tuple[View, Trail | None]:
    """Return the chosen view, and the trail it shows, which the caller has to record.

    ``overlay`` draws on top; a task of the engine has the name of one of `OVERLAYS`, or "".

    Raises
    ------
    ValueError
        The view needs a camera that is missing, or that lacks the needed outputs.
    """
    if choice.view == "camera":
        return _camera_view(choice, batch, cameras), None
    drawn = (OVERLAYS[overlay](choice.view == "top") if overlay else None) if isinstance(overlay, str) else overlay
    markers = MARKERS if drawn is None else drawn.markers
    if choice.view == "top":
        return TopView(batch, beams=choice.own_beams, size_px=choice.size_px, markers=markers, overlay=drawn), None
    trail = Trail(batch)
    view = ThirdPersonView(
        batch,
        [camera.name for camera in cameras],
        trail,
        beams=choice.own_beams,
        others=choice.view != "third_person",
        size_px=choice.size_px,
        place=None if isinstance(choice.view, str) else choice.view,
        markers=markers,
        overlay=drawn,
        mesh=DroneMesh._of_world(mesh) if isinstance(mesh, World) else mesh,
        samples=choice.samples,
        style=choice.style,
    )
    return view, trail


def _camera_view(choice: Choice, batch: Batch, cameras: Sequence[CameraConfig]) -> CameraView:
    if not cameras:
        raise ValueError(
            "render_view: 'camera' needs a camera, and this env has none: give it camera=flockstep.CameraConfig()"
        )
    names = [camera.name for camera in cameras]
    if choice.camera is not None and choice.camera not in names:
        expected = ", ".join(map(repr, names))
        hint = did_you_mean(choice.camera, names)
        raise ValueError(f"render_camera: expected one of the cameras {expected}, got {choice.camera!r}{hint}")
    camera = cameras[0 if choice.camera is None else names.index(choice.camera)]
    if not {"rgb", "grey"} & set(camera.outputs):
        raise ValueError(f"render_view: 'camera' needs 'rgb' or 'grey' among its outputs, got {camera.outputs}")
    return CameraView(batch, camera.name, choice.size_px)
