"""Write a camera's frames as PNG files. Uses NumPy and Pillow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep.errors import did_you_mean, refuse_masked

if TYPE_CHECKING:
    from flockstep._core import Camera

Array: TypeAlias = npt.NDArray[Any]

_MM_PER_M = 1000.0
_MAX_MM = 65535

_DEPTH_COLORS = (
    (25, 15, 60),
    (95, 30, 120),
    (190, 55, 105),
    (240, 115, 75),
    (252, 185, 105),
    (255, 250, 200),
)  # from far to near
_GOLDEN = (5**0.5 - 1) / 2  # multiples of it spread evenly over the hues


def save_frames(
    camera: Camera,
    folder: str | PathLike[str],
    indices: int | Sequence[int] | npt.NDArray[np.integer[Any]] | None = None,
    outputs: Sequence[str] | None = None,
) -> list[Path]:
    """Write PNG files and return their paths; see `Camera.save_frames`."""
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("save_frames needs Pillow, which is not installed: pip install pillow") from error
    config = camera.config
    if isinstance(outputs, str):
        outputs = (outputs,)
    chosen = list(config.outputs if outputs is None else outputs)
    for output in chosen:
        if output not in config.outputs:
            expected = ", ".join(config.outputs)
            hint = did_you_mean(output, config.outputs)
            raise ValueError(f'outputs: expected outputs of camera "{config.name}" ({expected}), got {output!r}{hint}')
    drones = _drones(camera, indices)

    root = Path(folder)
    root.mkdir(parents=True, exist_ok=True)
    digits = len(str(len(camera.frame_step) - 1))
    paths = []

    def write(drone: int, kind: str, image: Array) -> None:
        path = root / f"{config.name}-{drone:0{digits}}-{kind}.png"
        Image.fromarray(np.ascontiguousarray(image)).save(path)
        paths.append(path)

    for output in chosen:
        images = getattr(camera, output)
        span = depth_span(images[drones]) if output == "depth" else (0.0, 0.0)
        for drone in drones:
            image = images[drone]
            if image.ndim == 3 and config.layout == "chw":
                image = image.transpose(1, 2, 0)
            write(drone, output, _as_written(output, image))
            if output == "depth":
                write(drone, "depth-color", depth_rgb(image, *span))
            elif output in ("semantic", "instance"):
                write(drone, f"{output}-color", id_rgb(image))
    return paths


def _drones(camera: Camera, indices: int | Sequence[int] | npt.NDArray[np.integer[Any]] | None) -> list[int]:
    step, name = camera.frame_step, camera.config.name
    if indices is None:
        drones: list[int] = np.flatnonzero(step >= 0).tolist()
        if not drones:
            raise ValueError(f'camera "{name}": no drone has a frame; call sense or capture first')
        return drones
    drones = selected(indices, len(step))
    for index in drones:
        if step[index] < 0:
            raise ValueError(f'camera "{name}": the frame of drone {index} is stale; call sense or capture first')
    return drones


def selected(indices: int | Sequence[int] | npt.NDArray[np.integer[Any]], count: int) -> list[int]:
    """Return the indices as a list.

    Raises
    ------
    ValueError
        One is not an integer from 0 to ``count - 1``.
    """
    refuse_masked("indices", indices)
    chosen: list[int] = np.atleast_1d(np.asarray(indices)).tolist()
    for index in chosen:
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < count:
            raise ValueError(f"indices: expected integers from 0 to {count - 1}, got {index!r}")
    return chosen


def depth_mm(depth: Array) -> npt.NDArray[np.uint16]:
    """Return depths (m) in millimetres like depth cameras: 0 without a hit or beyond 65.535 m."""
    with np.errstate(invalid="ignore"):
        mm = np.rint(depth.astype(np.float64) * _MM_PER_M)
        return np.where(mm <= _MAX_MM, mm, 0).astype(np.uint16)


def normal_rgb(normal: Array) -> npt.NDArray[np.uint8]:
    """Return normals (..., 3) as colours, 127.5 * (n + 1); black without a hit."""
    seen = normal.any(axis=-1, keepdims=True)
    return np.where(seen, np.rint(127.5 * (np.clip(normal, -1, 1) + 1)), 0).astype(np.uint8)


def events_rgb(events: Array) -> npt.NDArray[np.uint8]:
    """Return counts of events (..., 2) as colours: ON in red, OFF in blue."""
    return np.insert(events, 1, 0, axis=-1)


def depth_span(depth: Array) -> tuple[float, float]:
    """Return the smallest and the largest finite depth (m) above 0, or (1, 1) if there is none."""
    seen = depth[np.isfinite(depth) & (depth > 0)]
    return (float(seen.min()), float(seen.max())) if seen.size else (1.0, 1.0)


def depth_rgb(depth: Array, nearest_m: float, farthest_m: float) -> npt.NDArray[np.uint8]:
    """Return depths (m) as colours (..., 3) on a logarithmic scale: bright is near, dark is far, black is no hit."""
    with np.errstate(divide="ignore", invalid="ignore"):
        span = max(np.log(farthest_m / nearest_m), 1e-9)
        nearness = np.clip(np.log(farthest_m / depth.astype(np.float64)) / span, 0, 1)
    at = np.linspace(0, 1, len(_DEPTH_COLORS))
    rgb = np.stack([np.interp(nearness, at, channel) for channel in np.array(_DEPTH_COLORS).T], axis=-1)
    rgb[~np.isfinite(depth)] = 0
    image: npt.NDArray[np.uint8] = np.rint(rgb).astype(np.uint8)
    return image


def id_rgb(ids: Array) -> npt.NDArray[np.uint8]:
    """Return ids as colours (..., 3): an id has the same colour everywhere, the next id a different one; 0 is black."""
    number = ids.astype(np.int64)
    hue = number * _GOLDEN % 1.0
    saturation, value = np.array([0.45, 0.75])[number % 2], np.array([0.95, 0.8, 0.65])[number % 3]
    # From hue, saturation and value to red, green and blue.
    ramp = np.abs((hue[..., None] + np.array([0, 2 / 3, 1 / 3])) % 1 * 6 - 3) - 1
    rgb = value[..., None] * (1 - saturation[..., None] * (1 - np.clip(ramp, 0, 1)))
    rgb[number == 0] = 0
    image: npt.NDArray[np.uint8] = np.rint(255 * rgb).astype(np.uint8)
    return image


def _as_written(output: str, image: Array) -> Array:
    encoders: dict[str, Callable[[Array], Array]] = {"depth": depth_mm, "normal": normal_rgb, "events": events_rgb}
    return encoders[output](image) if output in encoders else image
