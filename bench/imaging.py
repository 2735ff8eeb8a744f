"""Costs of colour detection, HSV and smaller images, in our kernels and in OpenCV, beside rendering a frame."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flockstep
from timing import RUNS, Call, Measured, Median, in_turns, timed

SIZES = {"64x48": (64, 48, 256), "640x480": (640, 480, 16)}  # width, height, frames
RANGES = {
    "green": flockstep.ColorRange(),
    "an rgb range": flockstep.ColorRange(space="rgb", low=(20, 90, 20), high=(120, 255, 120)),
    "an hsv range": flockstep.ColorRange(space="hsv", low=(40, 60, 60), high=(80, 255, 255)),
}
CAMERAS = {
    "rgb": {"outputs": ("rgb",)},
    "rgb and hsv": {"outputs": ("rgb", "hsv")},
    "rgb, resized to a quarter of width and height": {"outputs": ("rgb",), "quarter": True},
    "depth": {"outputs": ("depth",)},
    "depth, resized to a quarter of width and height": {"outputs": ("depth",), "quarter": True},
}


def batch_of(width: int, height: int, frames: int, camera: str = "rgb") -> flockstep.Batch:
    """Return drones at free positions of a camera playground; some have its green goal in view."""
    settings = dict(CAMERAS[camera])
    if settings.pop("quarter", False):
        settings["resize"] = (width // 4, height // 4)
    world = flockstep.World.load("playground/camera-train-1")
    config = flockstep.CameraConfig(width_px=width, height_px=height, **settings)
    batch = flockstep.Batch([world], frames, cameras=[config], num_threads=1)
    batch.set_pose(world.free_places(frames, seed=0))
    batch.sense()
    return batch


def microseconds(functions: dict[str, Call], frames: int, name: str) -> Iterator[Measured]:
    """Return the median processor time per frame."""
    for what, seconds in in_turns({name: timed(call) for name, call in functions.items()}, warm_up=True).items():
        yield name.format(what), 1e6 * Median(seconds) / frames, "us", RUNS


def measure() -> Iterator[Measured]:
    for size, (width, height, frames) in SIZES.items():
        images = np.array(batch_of(width, height, frames).camera().rgb)
        for color, wanted in RANGES.items():
            functions: dict[str, Call] = {
                "color_blob": lambda wanted=wanted, images=images: flockstep.color_blob(images, wanted),
                "color_components": lambda wanted=wanted, images=images: [
                    flockstep.color_components(image, wanted) for image in images
                ],
            }
            yield from microseconds(functions, frames, f"imaging/colour/{color}/{size}/{{}}")
        cameras: dict[str, Call] = {camera: batch_of(width, height, frames, camera).sense for camera in CAMERAS}
        yield from microseconds(cameras, frames, f"imaging/camera/{{}}/{size}/sense")
