"""Still pictures of the documents: what cameras see by every output, and drones on their way in worlds.

.venv/bin/python -m tools.films camera-sheet
.venv/bin/python -m tools.films camera-task
.venv/bin/python -m tools.films worlds
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import imageio.v3 as imageio
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

import flockstep
from flockstep.pictures.frames import normal_rgb
from flockstep.pictures.lines import Trail
from flockstep.pictures.picture import facing
from flockstep.pictures.third_person_view import ThirdPersonView
from tools.gallery import Image, View, picture, way_through

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


def draw_task(path: Path, steps: int = 25) -> None:
    """Write a picture of the camera task: the drone from behind, and beside it the image that the task observes."""
    view: dict[str, Any] = {"render_mode": "rgb_array", "render_view": "third_person", "render_size": (640, 480)}
    envs = gymnasium.make_vec("flockstep/CameraNavigation-v0", num_envs=1, worlds=WORLD, **view).unwrapped
    assert isinstance(envs, flockstep.DroneVectorEnv)
    envs.reset(seed=0)
    for _ in range(steps):
        envs.step(np.zeros(1, np.int64))  # forward
    ((behind,),) = (envs.render(),)
    observed = envs.batch.camera().rgb[0]
    scale = behind.shape[0] // observed.shape[0]
    imageio.imwrite(path, np.concatenate([behind, observed.repeat(scale, axis=0).repeat(scale, axis=1)], axis=1))
    envs.close()


def draw_sheet(path: Path) -> None:
    """Write a sheet of camera frames, with a row for each pose and a column for each output."""
    camera = flockstep.CameraConfig(
        width_px=TILE_PX[0], height_px=TILE_PX[1], outputs=OUTPUTS, samples_per_pixel=4, shadows=True
    )
    batch = flockstep.Batch([flockstep.World.load(WORLD)], len(POSES), cameras=[camera])
    positions = np.array([position for position, _ in POSES.values()], np.float32)
    batch.set_pose(positions, np.stack([facing(position, target) for position, target in POSES.values()]))
    batch.capture()
    left, top, gap = 0.34, 0.30, 0.04  # inches, at 100 pixels per inch
    width, height = TILE_PX[0] / 100, TILE_PX[1] / 100
    size = (left + len(OUTPUTS) * (width + gap), top + len(POSES) * (height + gap))
    figure = plt.figure(figsize=size)
    for column, output in enumerate(OUTPUTS):
        x = left + column * (width + gap)
        title = f"{output}, 0 to {FAR_M:g} m" if output == "depth" else output
        figure.text((x + width / 2) / size[0], 1 - top / 2 / size[1], title, ha="center", va="center")
        for row, pose in enumerate(POSES):
            y = size[1] - top - (row + 1) * (height + gap) + gap
            axes = figure.add_axes((x / size[0], y / size[1], width / size[0], height / size[1]))
            axes.imshow(shown(output, getattr(batch.camera(), output)[row]), interpolation="none", aspect="auto")
            axes.axis("off")
            if column == 0:
                place = {"x": left / 2 / size[0], "y": (y + height / 2) / size[1]}
                figure.text(**place, s=pose, rotation=90, ha="center", va="center")
    figure.savefig(path, dpi=100)
    plt.close(figure)


SIZE_PX = (1120, 630)
LIDAR = flockstep.LidarConfig(beams=60, hfov_deg=360.0, max_range_m=5.0)


@dataclass(frozen=True)
class Flight:
    """A flight along the path of a scene, and the moment of its picture."""

    scene: str
    share: float
    """Fraction of the path that the drone has flown."""
    view: View | None = None
    """Viewer and target, m. None: from behind the drone."""


def view(position: tuple[float, float, float], target: tuple[float, float, float]) -> View:
    """Return a view from a position towards a target, m."""
    return np.array(position, np.float32), np.array(target, np.float32)


#: The flights by the name of their picture.
FLIGHTS = {
    "forest": Flight("outdoor/forest", 0.2),
    "office": Flight("indoor/office", 0.46, view((15, 7, 2.3), (18.7, 11.5, 1.2))),
    "warehouse": Flight("indoor/warehouse", 0.12, view((4, 14, 3.0), (11, 18.9, 1.6))),
}
#: The scene of city.jpg, and a view across its square.
CITY, ACROSS_THE_SQUARE = "outdoor/city", view((34, 18, 36), (62, 64, 6))


def fly(flight: Flight, size_px: tuple[int, int] = SIZE_PX) -> Image:
    """Return a picture of a drone on its way, with its LiDAR beams and its trail."""
    world = flockstep.World.load(flight.scene)
    batch = flockstep.Batch([world], lidar=LIDAR)
    way, trail = way_through(world), Trail(batch)
    for position in way[: round(flight.share * len(way))]:
        batch.move(position[None])
        trail.record()
    batch.sense()
    return ThirdPersonView(batch, trail=trail, size_px=size_px, place=flight.view, markers=()).frame(0)


def draw_worlds(folder: Path) -> None:
    """Draw forest.jpg, city.jpg, office.jpg and warehouse.jpg."""
    images = {name: fly(flight) for name, flight in FLIGHTS.items()}
    images["city"] = picture(flockstep.World.load(CITY), *ACROSS_THE_SQUARE, SIZE_PX)
    for name, image in images.items():
        imageio.imwrite(folder / f"{name}.jpg", image, quality=85)
