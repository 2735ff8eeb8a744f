"""The thesis's pictures: each is one image of several panels, docs/images/thesis-NAME.jpg."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

import flockstep
from flockstep.pictures.body import Body
from flockstep.pictures.stage import Stage
from flockstep.pictures.third_person_view import ThirdPersonView
from flockstep.quadrotor_mesh import hull_edges
from training import plot_blob

IMAGES = Path(__file__).resolve().parents[1] / "docs" / "images"
PANEL_PX = (800, 600)
SAMPLES = 9  # per pixel
GREEN = (30, 200, 60)
T650 = flockstep.DroneModel.load("t650")
LEVEL = (1.0, 0.0, 0.0, 0.0)

Image = npt.NDArray[np.uint8]
Point = Sequence[float]
Panel = tuple[str, Image]  # its caption


def compose(name: str, panels: Sequence[Panel], columns: int = 2, width_in: float = 10.0) -> None:
    """Write panels with their captions as one picture."""
    rows = -(-len(panels) // columns)
    height, width, _ = panels[0][1].shape
    size = (width_in, rows * (width_in / columns * height / width + 0.32))
    figure, grid = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    for axes, (caption, image) in zip(grid.flat, panels, strict=False):
        axes.imshow(image, interpolation="antialiased")
        axes.set(xlabel=caption, xticks=[], yticks=[])
        axes.spines[:].set_visible(False)
    figure.savefig(IMAGES / f"thesis-{name}.jpg", dpi=110, pil_kwargs={"quality": 85})
    plt.close(figure)


def studio(**more: Any) -> flockstep.World:
    """Return a bright room of 12 x 12 x 5 m around the origin."""
    scene = {"flockstep_scene": 1, "name": "studio", "room": {"min": [-6, -6, 0], "max": [6, 6, 5]}, **more}
    return flockstep.World.from_dict(scene)


def pitched(down_deg: float) -> list[float]:
    """Return the quaternion of a mounting that faces forward and down."""
    half = np.radians(down_deg) / 2
    return [float(np.cos(half)), 0.0, float(np.sin(half)), 0.0]


def flying(
    world: flockstep.World, position: Point, view: tuple[Point, Point], style: str = "bright", **sensors: Any
) -> Image:
    """Return a picture, from one point towards another, of the Tarot 650 with its sensors' beams and frustums."""
    batch = flockstep.Batch(world, drone=T650, **sensors)
    batch.set_pose([list(position)], [list(LEVEL)])
    batch.sense()
    cameras = [camera.name for camera in sensors.get("cameras", ())]
    place = (np.array(view[0], float), np.array(view[1], float))
    return ThirdPersonView(
        batch, cameras, place=place, size_px=PANEL_PX, samples=SAMPLES, style=style, markers=()
    ).frame(0)


def hull() -> None:
    """Draw figure 4.3: the convex hull over the Tarot's mesh, from the side and from above."""
    panels = []
    at = np.array([0.0, 0.0, 1.5])
    for caption, offset in (("(a) from behind", (-0.62, 0.58, 0.42)), ("(b) from above", (-0.02, 0.0, 1.0))):
        stage = Stage(studio(), 0.93, PANEL_PX, SAMPLES)
        canvas = stage.seen_from(at + offset, at, [Body(T650).at(at, np.array(LEVEL))])
        edges = at + hull_edges(np.asarray(T650.hull, float))
        canvas.lines(edges[:, 0], edges[:, 1], GREEN, width_px=4)
        panels.append((caption, canvas.rgb))
    compose("hull", panels)


def lidars() -> None:
    """Draw figure 4.4: the beams of four LiDARs."""
    pillars = [{"center": [x, y], "z": [0, 5], "radius": 0.25} for x, y in ((2.1, -0.9), (0.3, -2.0), (-1.7, 0.7))]
    world, at, view = studio(pillars=pillars), (0.0, 0.0, 1.6), ((1.7, 2.8, 3.5), (0.25, 0.2, 1.25))
    settings = {
        "(a) 35 beams over 270°, 3 m": flockstep.LidarConfig(),
        "(b) 72 beams all around, 2 m": flockstep.LidarConfig(beams=72, hfov_deg=360, max_range_m=2),
        "(c) 8 channels of 15 beams, 90° x 40°, 3 m": flockstep.LidarConfig(
            beams=15, channels=8, hfov_deg=90, vfov_deg=40
        ),
        "(d) 20 beams over 180°, 2 m, mounted 30° downwards": flockstep.LidarConfig(
            beams=20, hfov_deg=180, max_range_m=2, quat_wxyz=pitched(30)
        ),
    }
    compose("lidars", [(name, flying(world, at, view, lidar=each)) for name, each in settings.items()])


def mountings() -> None:
    """Draw figure 4.6: the frustums of two cameras, and what they see."""
    world, at = flockstep.World.load("bench/complex"), None
    start = np.asarray(world.start, float)
    panels = []
    for caption, down_deg in (("(a) facing forward", 0.0), ("(b) forward and down by 60°", 60.0)):
        eye = flockstep.CameraConfig(offset_m=(0.15, 0.0, -0.05), quat_wxyz=pitched(down_deg), samples_per_pixel=4)
        at = (0.0, 0.0, 1.6)
        panels.append((caption, flying(studio(), at, ((-0.9, 2.1, 2.3), (0.35, 0.0, 1.25)), cameras=[eye])))
        seen = flockstep.render(world, start, LEVEL, camera=eye)["rgb"]
        panels.append((f"{caption[:3]} its image", seen))
    compose("mountings", panels)


def fields_of_view() -> None:
    """Draw figure 4.7: one view with four fields of view."""
    world = flockstep.World.load("bench/complex")
    panels = []
    for letter, hfov_deg in zip("abcd", (60, 90, 120, 150), strict=True):
        camera = flockstep.CameraConfig(hfov_deg=hfov_deg, samples_per_pixel=4, shadows=True)
        panels.append((f"({letter}) {hfov_deg}°", flockstep.render(world, world.start, LEVEL, camera=camera)["rgb"]))
    compose("fields-of-view", panels)


def beams() -> None:
    """Draw figure 5.3: a LiDAR with 125 beams, from the side and from above."""
    lidar, world = (
        flockstep.LidarConfig(beams=125, hfov_deg=360, max_range_m=10),
        flockstep.World.load("playground/train-2"),
    )
    at = (4.2, 8.0, 3.2)
    panels = [
        ("(a) from behind", flying(world, at, ((1.0, 10.6, 4.9), (5.0, 7.4, 2.9)), "dark", lidar=lidar)),
        ("(b) from above", flying(world, at, ((4.0, 8.0, 5.2), (4.6, 7.9, 3.0)), "dark", lidar=lidar)),
    ]
    compose("beams", panels)


def environments() -> None:
    """Draw figure 5.4: the two environments of the camera's benchmark."""
    panels = []
    for caption, name in (("(a) simple", "bench/simple"), ("(b) complex", "bench/complex")):
        world = flockstep.World.load(name)
        camera = flockstep.CameraConfig(samples_per_pixel=4, shadows=True)
        panels.append((caption, flockstep.render(world, world.start, LEVEL, camera=camera)["rgb"]))
    compose("environments", panels)


def opened(world: flockstep.World) -> flockstep.World:
    """Return a playground without its ceiling and its near wall."""
    scene = world.to_dict()
    (x, y, z), material = scene["room"]["max"], scene.pop("room")["material"]
    walls = (
        {"center": [x / 2, y / 2, -0.05], "size": [x, y, 0.1]},
        {"center": [x / 2, y, z / 2], "size": [x, 0.1, z]},
        {"center": [0, y / 2, z / 2], "size": [0.1, y, z]},
        {"center": [x, y / 2, z / 2], "size": [0.1, y, z]},
    )
    return flockstep.World.from_dict({**scene, "boxes": [{**wall, "material": material} for wall in walls]})


def playgrounds(name: str, worlds: str, columns: int) -> None:
    """Draw figures 6.1 and 6.6: playgrounds with start, waypoints and goal."""
    camera = flockstep.CameraConfig(hfov_deg=58, samples_per_pixel=SAMPLES, shadows=True)
    panels = []
    for letter, world in zip("abcde", flockstep.scenes.load(worlds), strict=False):
        seen = flockstep.render(opened(world), (7, -0.5, 16.0), look_at=(7, 6.4, 0.0), camera=camera)["rgb"]
        panels.append((f"({letter}) {Path(world.name).name}", seen))
    compose(name, panels, columns)


def green() -> None:
    """Draw figure 6.5: from a capture to the direction of the green."""
    world, camera = flockstep.World.load("playground/camera-train-1"), flockstep.CameraConfig(samples_per_pixel=4)
    seen = flockstep.render(world, (7.0, 8.0, 3.0), LEVEL, camera=camera)["rgb"]
    plot_blob.plot([seen], IMAGES / "thesis-green.jpg")


PICTURES: dict[str, Callable[[], None]] = {
    "hull": hull,
    "lidars": lidars,
    "mountings": mountings,
    "fields-of-view": fields_of_view,
    "beams": beams,
    "environments": environments,
    "playgrounds": lambda: playgrounds("playgrounds", "train", 3),
    "camera-playgrounds": lambda: playgrounds("camera-playgrounds", "camera-train", 2),
    "green": green,
}


def draw() -> None:
    """Draw all."""
    for name, each in PICTURES.items():
        print(f"== pictures, {name}", flush=True)
        each()


if __name__ == "__main__":
    draw()
