"""Costs of colour detection, HSV and smaller images, in our kernels and in OpenCV, beside rendering a frame."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

import flockstep

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
RUNS = 7

Measured = tuple[str, float, str, int]  # name, value, unit, runs


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


def microseconds(functions: dict[str, Callable[[], object]], frames: int) -> dict[str, float]:
    """Return the median processor time per frame; the functions alternate."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for function in functions.values():
        function()
    for _ in range(RUNS):
        for name, function in functions.items():
            before = time.process_time()
            function()
            times[name].append((time.process_time() - before) / frames * 1e6)
    return {name: statistics.median(taken) for name, taken in times.items()}


def measure() -> list[Measured]:
    found: list[Measured] = []
    for size, (width, height, frames) in SIZES.items():
        images = np.array(batch_of(width, height, frames).camera().rgb)
        for color, wanted in RANGES.items():
            taken = microseconds(
                {
                    "color_blob": lambda wanted=wanted, images=images: flockstep.color_blob(images, wanted),
                    "color_components": lambda wanted=wanted, images=images: [
                        flockstep.color_components(image, wanted) for image in images
                    ],
                },
                frames,
            )
            found += [(f"imaging/colour/{color}/{size}/{name}", us, "us", RUNS) for name, us in taken.items()]
        batches = {camera: batch_of(width, height, frames, camera) for camera in CAMERAS}
        for camera, us in microseconds({name: batch.sense for name, batch in batches.items()}, frames).items():
            found.append((f"imaging/camera/{camera}/{size}/sense", us, "us", RUNS))
    return found
