"""Frames as PNG files."""

import sys

import numpy as np
import pytest
from messages import refused
from PIL import Image

import flockstep
from flockstep.pictures.frames import depth_mm, depth_rgb, events_rgb, id_rgb, normal_rgb

OUTPUTS = ("rgb", "depth", "semantic", "instance", "normal", "grey", "hsv", "events")


def batch_of(room, num_drones=2, **camera):
    config = flockstep.CameraConfig(**{"width_px": 40, "height_px": 30, "outputs": OUTPUTS, **camera})
    return flockstep.Batch([room], num_drones, cameras=[config])


def read(path):
    with Image.open(path) as image:
        return np.array(image)


@pytest.mark.parametrize("layout", ["hwc", "chw"])
def test_files_hold_what_the_camera_saw(room, tmp_path, layout):
    batch = batch_of(room, layout=layout)
    batch.set_pose(np.float32([[2, 4, 2], [5, 6, 1]]))
    batch.sense()
    camera = batch.camera()
    paths = camera.save_frames(tmp_path / "made" / "for it")
    kinds = (*OUTPUTS, "depth-color", "semantic-color", "instance-color")
    assert sorted(path.name for path in paths) == sorted(f"front-{i}-{kind}.png" for i in (0, 1) for kind in kinds)
    for path in paths:
        if path.stem.endswith("-color"):
            continue
        index, output = int(path.stem.split("-")[1]), path.stem.split("-")[2]
        written, frame = read(path), getattr(camera, output)[index]
        if output in ("rgb", "normal", "hsv", "events") and layout == "chw":
            frame = frame.transpose(1, 2, 0)
        if output == "depth":
            assert written.dtype == np.uint16
            np.testing.assert_allclose(written / 1000, frame, atol=0.5001e-3)
        elif output == "normal":
            np.testing.assert_allclose(written / 127.5 - 1, frame, atol=0.51 / 127.5)
        elif output == "events":
            np.testing.assert_array_equal(written[..., [0, 2]], frame)
            assert not written[..., 1].any()
        else:
            assert written.dtype == frame.dtype
            np.testing.assert_array_equal(written, frame)


def test_events_are_red_and_blue():
    np.testing.assert_array_equal(events_rgb(np.uint8([[[3, 0], [1, 255]]])), [[[3, 0, 0], [1, 0, 255]]])


def luminance(rgb):
    return rgb @ [0.299, 0.587, 0.114]


def test_pictures_of_depth_and_ids_can_be_looked_at(room, tmp_path):
    """Pixels differ in colour exactly if they differ in value, and the colours use most of the range of brightness."""
    batch = batch_of(room)
    batch.set_pose(np.float32([[2, 4, 2], [1.5, 3, 1]]))
    batch.sense()
    camera = batch.camera()
    camera.save_frames(tmp_path)
    shown = [read(tmp_path / f"front-{i}-depth-color.png") for i in (0, 1)]
    depth, brightness = camera.depth.ravel(), luminance(np.stack(shown)).ravel()
    in_order = brightness[np.argsort(depth)]
    assert (np.diff(in_order) <= 2).all()  # near is brighter, on one scale for both frames; 2 is for rounding
    assert (np.ptp(brightness) > 180) & (brightness.std() > 30)
    for output in ("semantic", "instance"):
        ids = getattr(camera, output)[1]
        rgb = read(tmp_path / f"front-1-{output}-color.png").astype(int)
        colors = np.stack([rgb[ids == number][0] for number in np.unique(ids)])
        assert len(colors) > 1
        for number, color in zip(np.unique(ids), colors, strict=True):
            assert (rgb[ids == number] == color).all()
        apart = np.abs(colors[:, None] - colors).sum(axis=-1)[~np.eye(len(colors), dtype=bool)]
        assert apart.min() > 60


def test_colors_of_ids_next_to_each_other_differ_and_nothing_is_black():
    rgb = id_rgb(np.array([0, *range(1, 40), 65533, 65534, 65535], np.uint16)).astype(int)
    assert (rgb[0] == 0).all()
    assert (rgb[1:].max(axis=1) > 100).all()
    assert np.abs(np.diff(rgb[1:], axis=0)).sum(axis=1).min() > 60
    black = depth_rgb(np.float32([np.inf, 1.0, 8.0]), 1.0, 8.0)
    assert black[0].tolist() == [0, 0, 0]
    assert luminance(black[1]) > 200 > 60 > luminance(black[2]) > 0
    assert depth_rgb(np.float32([[np.inf]]), 1.0, 1.0).tolist() == [[[0, 0, 0]]]


def test_nothing_seen_is_zero():
    np.testing.assert_array_equal(
        depth_mm(np.float32([np.inf, 65.535, 65.536, 0.0004, 1.2344])), [0, 65535, 0, 0, 1234]
    )
    np.testing.assert_array_equal(normal_rgb(np.float32([[0, 0, 0], [0, 0, -1]])), [[0, 0, 0], [128, 128, 0]])


def test_numbers_are_as_long_as_the_longest(room, tmp_path):
    batch = batch_of(room, 11, outputs=("grey",), name="belly")
    batch.sense()
    paths = batch.camera("belly").save_frames(tmp_path, indices=np.array([3, 10]), outputs=["grey"])
    assert [path.name for path in paths] == ["belly-03-grey.png", "belly-10-grey.png"]
    assert [path.name for path in batch.camera("belly").save_frames(str(tmp_path), 7)] == ["belly-07-grey.png"]


def test_only_drones_with_a_frame_are_saved(room, tmp_path):
    batch = batch_of(room, 3, outputs=("rgb",))
    with refused(ValueError, "no drone has a frame"):
        batch.camera().save_frames(tmp_path)
    batch.capture(np.array([True, False, True]))
    assert [path.name for path in batch.camera().save_frames(tmp_path)] == ["front-0-rgb.png", "front-2-rgb.png"]
    with refused(ValueError, "the frame of drone 1"):
        batch.camera().save_frames(tmp_path, [0, 1])


def test_bad_input_writes_nothing(room, tmp_path):
    batch = batch_of(room, outputs=("rgb",))
    batch.sense()
    camera = batch.camera()
    with refused(ValueError, "outputs", "depth"):
        camera.save_frames(tmp_path, outputs=["rgb", "depth"])
    for wrong in (2, -1, [0, 2], [0.5], ["a"]):
        with refused(ValueError, "indices"):
            camera.save_frames(tmp_path, wrong)
    assert not list(tmp_path.iterdir())


def test_without_pillow_the_error_says_what_to_install(room, tmp_path, monkeypatch):
    batch = batch_of(room)
    batch.sense()
    monkeypatch.setitem(sys.modules, "PIL", None)
    with refused(ModuleNotFoundError, "pip install pillow"):
        batch.camera().save_frames(tmp_path)
