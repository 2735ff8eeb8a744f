"""The Python argument `tracer`: its effects, and outputs that do not depend on it."""

import gymnasium
import numpy as np
import pytest

import flockstep
from flockstep import CameraConfig, LidarConfig, World, WorldPool

CAMERA = CameraConfig(width_px=32, height_px=24, outputs=["rgb", "depth"])
GRID = LidarConfig(channels=8, beams=180, hfov_deg=360, vfov_deg=30, max_range_m=20)


def envs_in(worlds, tracer, num_envs=6, **arguments):
    return flockstep.DroneVectorEnv(
        num_envs, worlds=worlds, camera=CAMERA, lidar=GRID, tracer=tracer, random_start=True, **arguments
    )


def fly(envs, steps=6):
    """Return all observations and images."""
    seen = []
    envs.reset(seed=5)
    for step in range(steps):
        envs.step([step % 4] * envs.num_envs)
        camera = envs.batch.camera()
        seen.append([envs.batch.lidar().ranges.copy(), camera.rgb.copy(), camera.depth.copy()])
    return seen


@pytest.fixture(scope="module")
def office():
    return World.office(4)


def test_it_measures_what_embree_does(office):
    tiles, embree = envs_in(office, "tiles"), envs_in(office, "embree")
    for a, b in zip(fly(tiles), fly(embree), strict=True):
        for near, far in ((a[0], b[0]), (a[2], b[2])):
            same = np.isclose(near, far, rtol=1e-4, atol=1e-4)
            assert np.mean(same) > 0.999
        # Some faces of doors and their frames are coplanar: either may be visible.
        assert np.mean(np.abs(a[1].astype(int) - b[1]) <= 1) > 0.99
    assert embree.batch.embree_rays > tiles.batch.embree_rays


def test_tiles_are_taken_by_themselves(office):
    for a, b in zip(fly(envs_in(office, "tiles")), fly(envs_in(office, "auto")), strict=True):
        for one, other in zip(a, b, strict=True):
            np.testing.assert_array_equal(one, other)


def test_threads_and_blocks_do_not_matter(office):
    for a, b in zip(fly(envs_in(office, "tiles")), fly(envs_in(office, "tiles", num_threads=2)), strict=True):
        for one, other in zip(a, b, strict=True):
            np.testing.assert_array_equal(one, other)


def test_a_pool_builds_its_trees_ahead():
    pool = WorldPool(lambda number: World.office(number % 2), size=2)
    for a, b in zip(fly(envs_in(pool, "tiles", 3)), fly(envs_in(pool, "tiles", 3)), strict=True):
        np.testing.assert_array_equal(a[0], b[0])


def test_a_snapshot_of_the_other_is_refused(office):
    tiles, embree = envs_in(office, "tiles"), envs_in(office, "embree")
    tiles.reset(seed=0)
    with pytest.raises(ValueError, match="another"):
        embree.restore(tiles.snapshot())


def test_wrong_names():
    with pytest.raises(ValueError, match=r"tracer: expected .*auto.*tiles.*embree.*, got .*embree3"):
        flockstep.Batch([World.playground(0)], tracer="embree3")
    with pytest.raises(ValueError, match="tracer"):
        gymnasium.make_vec("flockstep/LidarNavigation-v0", num_envs=2, tracer="gpu")
    with pytest.raises(TypeError, match="tracer"):
        flockstep.Batch([World.playground(0)], tracer=3)
