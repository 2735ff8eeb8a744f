"""Images that take time, by a rolling shutter or blur, against still images from the poses in between."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from messages import refused
from scipy.spatial.transform import Rotation, Slerp
from test_camera import ROUND
from test_lens import WIDE

import flockstep
from flockstep import Batch, CameraConfig

WORLD = flockstep.World.from_dict(ROUND)
STEP_S = 0.1
SIZE = {"width_px": 20, "height_px": 18, "offset_m": [0.2, -0.1, 0.05], "quat_wxyz": [0.96, 0, 0.28, 0]}
OUTPUTS = ("rgb", "grey", "depth", "instance", "normal")
AT = np.array([[0, 0, 2], [-1, -2, 1], [0.5, 2, 3]])
RATES = np.array([[0, 0, 5], [3, -2, 1], [0, 0, 0]])  # rad/s
TIMES: dict[str, Any] = {"rolling_shutter_s": 0.04, "exposure_s": 0.03, "blur_samples": 3}
EMBREE = {"tracer": "embree"}  # traces triangles by rows and in tiles alike

Floats = npt.NDArray[np.float64]


def make(drones: int = 3, *, batch: dict[str, Any] | None = None, **fields: Any) -> Batch:
    return Batch([WORLD], drones, cameras=[CameraConfig(**{**SIZE, "outputs": OUTPUTS, **fields})], **(batch or {}))


def poses(step: int) -> tuple[Floats, Floats]:
    """The poses of drones that turn and, all but the first one, fly."""
    turned = Rotation.from_rotvec(RATES * STEP_S * step)
    flown = [[0, 0, 0], [0.2 * step, 0.1, 0], [0, -0.1 * step, -0.1 * step]]
    return AT + flown, turned.as_quat(scalar_first=True)


def fly(batch: Batch, step: int) -> None:
    position, quat = poses(step)
    drones = batch.num_drones
    if step == 0:
        batch.set_pose(position[:drones], quat[:drones])
    else:
        batch.move(position[:drones], quat[:drones])
    batch.sense()


def images(batch: Batch) -> dict[str, npt.NDArray[Any]]:
    camera = batch.camera()
    return {name: getattr(camera, name).copy() for name in camera.config.outputs}


def between(step: int, drone: int, age_s: Floats) -> tuple[Floats, Floats]:
    """The poses (K,) of a drone at these times before a step."""
    (p0, q0), (p1, q1) = poses(step - 1), poses(step)
    share = np.minimum(age_s / STEP_S, 1)
    rotations = Rotation.from_quat([q1[drone], q0[drone]], scalar_first=True)
    return p1[drone] + share[:, None] * (p0 - p1)[drone], Slerp([0, 1], rotations)(share).as_quat(scalar_first=True)


def expected(step: int, drone: int, **fields: Any) -> dict[str, npt.NDArray[Any]]:
    """The images of a drone from still images, one for each row and each pose of its exposure."""
    rolling_s, exposure_s = fields.pop("rolling_shutter_s", 0), fields.pop("exposure_s", 0)
    fields.pop("adaptive_samples", None)  # without effect on images that take time
    samples = fields.pop("blur_samples", 8) if exposure_s else 1
    height = {**SIZE, **fields}["height_px"]
    ends = rolling_s * (1 - np.arange(height) / max(height - 1, 1))
    ages = ends[:, None] + (np.linspace(exposure_s, 0, samples) if samples > 1 else 0.0)
    still = make(ages.size, **fields)
    still.set_pose(*between(step, drone, ages.ravel()))
    still.capture()
    found = {}
    for name, every in images(still).items():
        of_pose = every.reshape(height, samples, *every.shape[1:])
        rows = np.stack([of_pose[row, :, row] for row in range(height)])  # (H, samples, W, ...)
        mean = np.floor(rows.mean(axis=1) + 0.5) if name in ("rgb", "grey") else None
        found[name] = rows[:, -1] if mean is None else mean
    return found


@pytest.mark.parametrize(
    "fields",
    [
        {"rolling_shutter_s": 0.06},
        {"rolling_shutter_s": 0.06, **WIDE, "depth_kind": "range"},
        {"rolling_shutter_s": 0.06, "samples_per_pixel": 4, "adaptive_samples": True, "shadows": True},
        {"rolling_shutter_s": 0.1, "width_px": 35, "height_px": 3},
        {"exposure_s": 0.05},
        {"exposure_s": 0.1, "blur_samples": 2, "samples_per_pixel": 4, "height_px": 1},
        {**TIMES, "ambient_occlusion_rays": 2, "width_px": 7},
        {**TIMES, "width_px": 33, "height_px": 17},
    ],
)
def test_rows_and_colours_are_of_the_poses_in_between(fields: dict[str, Any]) -> None:
    batch, still = make(**fields), make(**{**fields, "rolling_shutter_s": 0, "exposure_s": 0})
    for step in range(3):
        fly(batch, step)
        fly(still, step)
    at_once = images(still)
    for drone in range(3):
        truth = expected(2, drone, **fields)
        same = images(batch)["instance"][drone] == truth["instance"]
        assert same.mean() > 0.99
        for name, image in images(batch).items():
            ours, theirs = image[drone].astype(float), truth[name].astype(float)
            if name in ("rgb", "grey"):
                assert (np.abs(ours - theirs) <= 1).mean() > 0.99, name
            else:
                close = np.isclose(ours, theirs, rtol=1e-3, atol=1e-3)
                assert close[same].mean() > 0.99, name
            # The last row's other outputs are of the reading, the first row's are not.
            if name == "depth":
                np.testing.assert_allclose(ours[-1], at_once[name][drone, -1], rtol=1e-4)
    changed = {name: (image != at_once[name]).mean() for name, image in images(batch).items()}
    assert changed["rgb"] > 0.05
    assert (changed["depth"] > 0.1) == ("rolling_shutter_s" in fields)


def test_an_image_of_a_drone_at_rest_is_still() -> None:
    batch, still = make(**TIMES, batch=EMBREE), make(batch=EMBREE)
    for each in (batch, still):
        fly(each, 0)
    np.testing.assert_equal(images(batch), images(still))  # the first image
    for each in (batch, still):
        fly(each, 1)
        fly(each, 0)  # placed
        each.move(*poses(0))
        each.sense()
    np.testing.assert_equal(images(batch), images(still))


def test_a_second_reading_repeats_the_image() -> None:
    batch = make(**TIMES)
    for step in range(2):
        fly(batch, step)
    moved = images(batch)
    batch.sense()
    batch.capture()
    np.testing.assert_equal(images(batch), moved)


def test_the_first_image_of_an_episode_is_still() -> None:
    keywords = {**EMBREE, "task": flockstep.NavigationConfig(), "lidar": flockstep.LidarConfig()}
    batch, still = (make(**times, capture_mode="on_demand", batch=keywords) for times in (TIMES, {}))
    for each in (batch, still):
        for step in range(2):
            fly(each, step)
            each.capture()
        each.reset()
        for step in (2, 3):
            each.move(*poses(step))
        each.capture()
    np.testing.assert_equal(images(batch), images(still))


@pytest.mark.parametrize("late", [{}, {"latency_s": 0.1}])
@pytest.mark.parametrize("threads", [1, 3])
def test_snapshots_growth_and_threads(late: dict[str, Any], threads: int) -> None:
    batch, other = (make(**TIMES, **late, batch={"num_threads": n}) for n in (threads, 2))
    grown = make(2, **TIMES, **late)
    for step in range(2):
        fly(batch, step)
        fly(grown, step)
    grown.spawn(position=poses(1)[0][2:], quat_wxyz=poses(1)[1][2:])
    other.restore(batch.snapshot())
    np.testing.assert_equal(images(other), images(batch))  # rendered again
    for step in range(2, 4):
        for each in (batch, other, grown):
            fly(each, step)
        np.testing.assert_equal(images(other), images(batch))
        for name, image in images(grown).items():
            np.testing.assert_array_equal(image[:2], images(batch)[name][:2])


def test_resized_images_are_of_the_moving_ones() -> None:
    fields = {"outputs": ("rgb", "hsv"), "layout": "chw", "width_px": 32, "height_px": 16}
    whole, small = make(**TIMES, **fields), make(**TIMES, **fields, resize=(16, 8))
    for step in range(2):
        fly(whole, step)
        fly(small, step)
    mean = images(whole)["rgb"].reshape(3, 3, 8, 2, 16, 2).mean(axis=(3, 5))
    assert np.abs(images(small)["rgb"] - mean).max() <= 0.5


@pytest.mark.parametrize("field", ["rolling_shutter_s", "exposure_s"])
@pytest.mark.parametrize("value", [-0.01, 1.1, math.nan, math.inf])
def test_bad_times_are_refused(field: str, value: float) -> None:
    with refused(ValueError, f"camera.{field}"):
        CameraConfig(**{field: value})


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"blur_samples": 1}, [1]),
        ({"blur_samples": 257}, [257]),
        ({"blur_samples": 1 << 30}, [1 << 30]),
        ({"blur_samples": 17, "samples_per_pixel": 16, "exposure_s": 0.01}, ["16", 17]),
    ],
)
def test_absurd_numbers_of_poses_are_refused(fields: dict[str, Any], said: list[Any]) -> None:
    with refused(ValueError, "camera.blur_samples", *said):
        CameraConfig(**fields)


@pytest.mark.parametrize("times", [(0.11, 0), (0, 0.11), (0.06, 0.05)])
def test_an_image_takes_no_longer_than_the_time_to_the_next(times: tuple[float, float]) -> None:
    fields: dict[str, Any] = {"rolling_shutter_s": times[0], "exposure_s": times[1]}
    with refused(ValueError, "camera.rolling_shutter_s + exposure_s", "0.100000"):
        make(**fields)
    make(**fields, rate_hz=5)
    make(**fields, capture_mode="on_demand")


@pytest.mark.parametrize("field", ["rolling_shutter_s", "exposure_s"])
def test_gl_refuses(field: str) -> None:
    fields: dict[str, Any] = {field: 0.02}
    with refused(ValueError, field, "gl"):
        make(**fields, batch={"camera_backend": "gl"})
