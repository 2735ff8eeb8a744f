"""Pictures from any viewpoint."""

import numpy as np
import pytest
from messages import refused

import flockstep
from flockstep.pictures.picture import facing
from flockstep.rotations import rotate


def test_a_picture_is_what_a_drones_camera_sees(room):
    camera = flockstep.CameraConfig(name="any", width_px=40, height_px=30, outputs=("rgb", "depth", "instance"))
    quat_wxyz = [0.8, 0.0, 0.0, 0.6]
    picture = flockstep.render(room, (3, 4, 2), quat_wxyz, camera=camera)
    batch = flockstep.Batch([room], cameras=[camera])
    batch.set_pose(np.float32([[3, 4, 2]]), np.float32([quat_wxyz]))
    batch.capture()
    assert list(picture) == ["rgb", "depth", "instance"]
    for output, array in picture.items():
        np.testing.assert_array_equal(array, getattr(batch.camera("any"), output)[0])


def test_by_default_it_is_large_and_faces_ahead(room):
    picture = flockstep.render(room, (2, 4, 2))
    assert picture["rgb"].shape == (480, 640, 3)
    np.testing.assert_array_equal(picture["rgb"], flockstep.render(room, (2, 4, 2), look_at=(3, 4, 2))["rgb"])


@pytest.mark.parametrize("target", [(4, 5, 3), (-1, 2, 0), (0, 0, 5), (0, 0, -5), (-3, 0, 0), (1e-3, 0, 1)])
def test_facing_points_there_and_stays_level(target):
    quat_wxyz = facing((0, 0, 0), target).astype(float)
    assert np.linalg.norm(quat_wxyz) == pytest.approx(1)
    np.testing.assert_allclose(rotate(quat_wxyz, np.array([1.0, 0, 0])), target / np.linalg.norm(target), atol=1e-6)
    left, up = rotate(quat_wxyz, np.array([0, 1.0, 0])), rotate(quat_wxyz, np.array([0, 0, 1.0]))
    assert left[2] == pytest.approx(0, abs=1e-6)
    assert up[2] >= -1e-6


def test_what_is_looked_at_is_in_the_middle(room):
    camera = flockstep.CameraConfig(width_px=101, height_px=75, outputs=("semantic",))
    seen = flockstep.render(room, (1, 7, 3.5), look_at=room.goal, camera=camera)["semantic"]
    assert seen[37, 50] == 65535


def test_bad_input_is_refused(room):
    with refused(ValueError, "look_at"):
        flockstep.render(room, (1, 1, 1), (1, 0, 0, 0), look_at=(2, 2, 2))
    with refused(ValueError, "look_at"):
        flockstep.render(room, (1, 1, 1), look_at=(1, 1, 1))
    with refused(ValueError, "position", (2,)):
        flockstep.render(room, (1, 1))
    with refused(ValueError, "quat_wxyz", (3,)):
        flockstep.render(room, (1, 1, 1), (1, 0, 0))
    with refused(ValueError, "position"):
        flockstep.render(room, (1, 1, np.nan))
