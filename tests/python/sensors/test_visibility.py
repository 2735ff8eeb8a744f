"""Objects that are only visible or only solid: sensors detect the former, drones hit the latter."""

import numpy as np
import pytest
from conftest import placed

import flockstep

DOWN = (0.5**0.5, 0.0, 0.5**0.5, 0.0)
X, SIZE = 3.0, (0.5, 4.0, 4.0)


def wall(builder, form, **flags):
    """Add a wall at X across the x axis, made of a primitive or of triangles."""
    material = builder.material("wall", [0.8, 0.2, 0.1])
    if form == "box":
        builder.box([X + 0.25, 0, 0], SIZE, material, **flags)
    else:
        corners = [[X, -2, -2], [X, 2, -2], [X, 2, 2], [X, -2, 2]]
        builder.mesh(corners, [[0, 1, 2], [0, 2, 3]], material, **flags)


def hall(form, **flags):
    """A room of 12 m with a wall in the middle of one side."""
    builder = flockstep.WorldBuilder("hall")
    builder.room([-6, -6, -6], [6, 6, 6], builder.material("room"))
    wall(builder, form, **flags)
    return builder.build()


@pytest.fixture(params=["box", "mesh"])
def form(request):
    return request.param


@pytest.mark.parametrize(("flags", "seen"), [({}, True), ({"solid": False}, True), ({"visible": False}, False)])
def test_sensors_see_what_is_visible(form, flags, seen):
    world = hall(form, **flags)
    expected = X if seen else 6.0
    assert world.raycast([[0, 0, 0]], [[1, 0, 0]], 20)["t_hit"] == pytest.approx(expected)
    camera = flockstep.CameraConfig(width_px=32, height_px=24, outputs=("depth", "instance"), far_m=50)
    pictures = []
    for backend in ("raycast", "gl"):
        batch = flockstep.Batch(
            [world], 1, lidar=flockstep.LidarConfig(beams=1, max_range_m=20), cameras=[camera], camera_backend=backend
        )
        batch.set_pose([[0, 0, 0]])
        batch.sense()
        batch.capture()
        assert batch.lidar().ranges[0, 0, 0] == pytest.approx(expected, abs=1e-5)
        camera_frames = batch.camera()
        pictures.append((camera_frames.depth[0].copy(), camera_frames.instance[0].copy()))
        assert pictures[-1][0][12, 16] == pytest.approx(expected, abs=1e-3)
        assert pictures[-1][1][12, 16] == (2 if seen else 1)  # numbers are those of the world
    np.testing.assert_allclose(pictures[0][0], pictures[1][0], rtol=1e-3)
    cloud = world.point_cloud(0.25)
    assert (cloud["objects"] == 1).any() == seen


def test_what_is_hidden_casts_no_shadow():
    builder = flockstep.WorldBuilder("yard")
    builder.plane([0, 0, 0], [20, 20], builder.material("ground", [1, 1, 1]))
    lit = builder.build()
    builder.box([0, 0, 3], [4, 4, 0.5], builder.material("roof"), visible=False)
    hidden = builder.build()
    frames = []
    for world in (lit, hidden):
        camera = flockstep.CameraConfig(width_px=32, height_px=24, shadows=True, quat_wxyz=DOWN)
        batch = placed([world], [[0, 0, 2]], cameras=[camera])
        batch.sense()
        batch.capture()
        frames.append(batch.camera().rgb[0].copy())
    np.testing.assert_array_equal(*frames)
