"""The sheet of camera frames, docs/camera-sheet.png: every output by every backend.

.venv/bin/python -m tools.camera_pictures --out docs
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import tyro

import flockstep
from flockstep.pictures.frames import normal_rgb
from flockstep.pictures.picture import facing

WORLD = "playground/camera-train-1"
#: Camera position and target (m).
POSES = {
    "near the start": ((2.0, 7.2, 3.4), (11.7, 6.3, 3.0)),
    "among pillars": ((6.6, 8.2, 3.6), (11.7, 6.3, 2.4)),
    "in a corner": ((0.5, 0.5, 4.8), (7.0, 7.0, 1.6)),
}
OUTPUTS = ("rgb", "depth", "semantic", "instance", "normal", "grey")
TILE_PX = (240, 180)
FAR_M = 18.0  # upper end of the depth colours

Image = npt.NDArray[np.uint8]


def shown(output: str, frame: npt.NDArray[Any]) -> Image:
    """Return the frame of an output as colours: near is bright, and every id has its own colour."""
    if output == "rgb":
        return frame
    if output == "grey":
        return np.repeat(frame[..., None], 3, axis=-1)
    if output == "normal":
        return normal_rgb(frame)
    if output == "depth":
        color = plt.get_cmap("magma_r")(np.clip(frame / FAR_M, 0, 1))
    else:
        color = plt.get_cmap("tab20")((7 + 7 * frame.astype(int)) % 20)
    image: Image = (255 * color[..., :3]).round().astype(np.uint8)
    image[~np.isfinite(frame) if output == "depth" else frame == 0] = 0
    return image


def capture(backend: str, world: flockstep.World) -> dict[str, npt.NDArray[Any]] | None:
    """Return the frames of all poses by output, or None if the backend is not available."""
    camera = flockstep.CameraConfig(
        width_px=TILE_PX[0], height_px=TILE_PX[1], outputs=OUTPUTS, samples_per_pixel=4, shadows=True
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # raycast replaces gl; the report also says so
        batch = flockstep.Batch([world], len(POSES), cameras=[camera], camera_backend=backend)
        positions = np.array([position for position, _ in POSES.values()], np.float32)
        batch.set_pose(positions, np.stack([facing(position, target) for position, target in POSES.values()]))
        batch.capture()
    if not batch.camera_backend_report().startswith(f"{backend}:"):
        return None
    return {output: getattr(batch.camera(), output).copy() for output in OUTPUTS}


def draw_sheet(path: Path, backends: Sequence[str] = ("raycast", "gl")) -> list[str]:
    """Write a sheet of camera frames, with a column for each output; return its backends."""
    world = flockstep.World.load(WORLD)
    frames = {backend: taken for backend in backends if (taken := capture(backend, world)) is not None}
    rows = [(pose, backend) for pose in range(len(POSES)) for backend in frames]
    left, top, gap = 0.62, 0.30, 0.04  # inches, at 100 pixels per inch
    width, height = TILE_PX[0] / 100, TILE_PX[1] / 100
    size = (left + len(OUTPUTS) * (width + gap), top + len(rows) * (height + gap))
    figure = plt.figure(figsize=size)
    for column, output in enumerate(OUTPUTS):
        x = left + column * (width + gap)
        title = f"{output}, 0 to {FAR_M:g} m" if output == "depth" else output
        figure.text((x + width / 2) / size[0], 1 - top / 2 / size[1], title, ha="center", va="center")
        for row, (pose, backend) in enumerate(rows):
            y = size[1] - top - (row + 1) * (height + gap) + gap
            axes = figure.add_axes((x / size[0], y / size[1], width / size[0], height / size[1]))
            axes.imshow(shown(output, frames[backend][output][pose]), interpolation="none", aspect="auto")
            axes.axis("off")
            if column == 0:
                label = f"{list(POSES)[pose]}\n{backend}"
                figure.text(
                    left / 2 / size[0], (y + height / 2) / size[1], label, rotation=90, ha="center", va="center"
                )
    figure.savefig(path, dpi=100)
    plt.close(figure)
    return list(frames)


@dataclass
class Args:
    """Draw camera-sheet.png."""

    out: Path = Path("out/cameras")
    """Folder for the picture."""


def main(args: Args) -> None:
    """Draw, and print the location."""
    args.out.mkdir(parents=True, exist_ok=True)
    backends = draw_sheet(args.out / "camera-sheet.png")
    print(f"camera-sheet.png (by {' and '.join(backends)}) is in {args.out}/")


if __name__ == "__main__":
    main(tyro.cli(Args))
