"""Views of `DroneVectorEnv.render`: from above, by the drone's own camera, from behind it, from a fixed place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep._core import Batch, CameraConfig
from flockstep.drone_mesh import DroneMesh
from flockstep.nearest_name import did_you_mean
from flockstep.pictures.drawing import Overlay
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.pictures.top_view import TopView
from flockstep.pictures.trail import Trail
from flockstep.task import MARKERS

Image: TypeAlias = npt.NDArray[np.uint8]

NAMES = ("top", "camera", "third_person", "fleet")
_MAX_PX = 8192


class View(Protocol):
    """Makes pictures of the envs of a batch."""

    def frame(self, env: int) -> Image:
        """Return the picture of one env, (height, width, 3) uint8, a new array."""


class CameraView:
    """The last frames of one camera of the drones, in colour or otherwise grey, with move lines; black if stale.

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


@dataclass(frozen=True)
class Choice:
    """The checked keywords ``render_view``, ``render_size`` and ``render_camera``."""

    view: str | tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]  # a name, or viewer and target positions
    size_px: tuple[int, int] | None  # width and height; None: the view's default
    camera: str | None  # a name; None: the first


def choose(view: Any, size: Any, camera: Any) -> Choice:
    """Check the three keywords.

    Raises
    ------
    ValueError
        A keyword is invalid; the message names it, the expected value and the value given.
    """
    if isinstance(view, str):
        if view not in NAMES:
            expected = ", ".join(map(repr, NAMES))
            raise ValueError(
                f"render_view: expected one of {expected} or two points, got {view!r}{did_you_mean(view, NAMES)}"
            )
    else:
        view = _place(view)
    if size is not None:
        pair = tuple(size) if isinstance(size, (Sequence, np.ndarray)) else ()
        if len(pair) != 2 or not all(_is_count(n) and 1 <= n <= _MAX_PX for n in pair):
            raise ValueError(f"render_size: expected (width, height) from 1 to {_MAX_PX} pixels, got {size!r}")
        size = (int(pair[0]), int(pair[1]))
    if camera is not None and view != "camera":
        raise ValueError(f"render_camera: expected None unless render_view='camera', got {camera!r}")
    return Choice(view, size, camera)


def _is_count(value: Any) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _place(view: Any) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    try:
        points = np.asarray(view, float)
    except (TypeError, ValueError):
        points = np.zeros(0)
    if points.shape != (2, 3) or not np.isfinite(points).all() or (points[0] == points[1]).all():
        expected = f"one of {', '.join(map(repr, NAMES))}, or two points (x, y, z): the eye and the point to look at"
        raise ValueError(f"render_view: expected {expected}, got {view!r}")
    return points[0], points[1]


def make(
    choice: Choice,
    batch: Batch,
    cameras: Sequence[CameraConfig],
    overlay: Overlay | None = None,
    mesh: DroneMesh | None = None,
) -> tuple[View, Trail | None]:
    """Return the chosen view, and the trail it shows, which the caller has to record.

    Raises
    ------
    ValueError
        The view needs a camera that is missing, or that lacks the needed outputs.
    """
    if choice.view == "camera":
        return _camera_view(choice, batch, cameras), None
    markers = MARKERS if overlay is None else overlay.markers
    if choice.view == "top":
        return TopView(batch, size_px=choice.size_px, markers=markers, overlay=overlay), None
    trail = Trail(batch)
    view = ThirdPersonView(
        batch,
        [camera.name for camera in cameras],
        trail,
        others=choice.view != "third_person",
        size_px=choice.size_px,
        place=None if isinstance(choice.view, str) else choice.view,
        markers=markers,
        overlay=overlay,
        mesh=mesh,
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
