"""Drones of an env that see each other: keywords, recipes, copies, pictures."""

import gymnasium
import numpy as np
import pytest
from conftest import begun
from messages import refused
from simple_tasks import Still

import flockstep
from flockstep import Batch, CameraConfig, DroneMesh, LidarConfig

ARROW = np.array([[0.5, 0, 0], [-0.3, 0.3, 0], [-0.3, -0.3, 0], [-0.2, 0, 0.25]], np.float32)
SIDES = [[0, 3, 2], [0, 1, 3], [1, 2, 3], [0, 2, 1]]
RED = DroneMesh(ARROW, SIDES, [0.9, 0.05, 0.05], "arrow")
OUTPUTS = ["rgb", "depth", "semantic", "instance", "normal"]


@pytest.fixture(scope="module")
def room():
    builder = flockstep.WorldBuilder("room")
    builder.room([-6, -6, 0], [6, 6, 4], builder.material("chalk", [0.7, 0.7, 0.65]))
    builder.start([0, 0, 2])
    builder.goal([-4, -4, 2])
    return builder.build()


def flock(room, **keywords):
    """Return three drones in a row along +x, 2 m apart, with a LiDAR and a camera."""
    lidar = LidarConfig(beams=4, hfov_deg=360, max_range_m=20)
    camera = CameraConfig(width_px=64, height_px=48, outputs=OUTPUTS)
    batch = Batch(room, 3, drones_per_env=3, lidar=lidar, cameras=[camera], **{"interaction": "sense", **keywords})
    batch.set_pose(np.float32([[0, 0, 2], [2, 0, 2], [4, 0, 2]]))
    batch.sense()
    return batch


def test_a_world_is_the_same_mesh(room):
    by_mesh, by_world = flock(room, drone_mesh=RED), flock(room, drone_mesh=RED.world())
    for output in OUTPUTS:
        np.testing.assert_array_equal(getattr(by_mesh.camera(), output), getattr(by_world.camera(), output))


@pytest.mark.parametrize(
    ("keywords", "error", "said"),
    [
        ({"interaction": "sometimes"}, ValueError, ["interaction", "sometimes"]),
        ({"drone_mesh": 3}, TypeError, ["drone_mesh", 3]),
        ({"drone_mesh": RED, "interaction": "collide"}, ValueError, ["drone_mesh", None]),
        ({"drone_mesh": flockstep.World.playground(0)}, ValueError, ["drone_mesh", "triangles"]),
    ],
)
def test_bad_keywords_are_refused(room, keywords, error, said):
    with refused(error, *said):
        flock(room, **keywords)


def test_a_task_declares_it(room):
    class Idle(Still):
        observation_space = gymnasium.spaces.Box(0, 100, (4,), np.float32)
        lidar = LidarConfig(beams=4, hfov_deg=360, max_range_m=20)
        interaction = "sense"

        def reset(self, batch, mask):
            batch.set_pose(np.tile(np.float32([[0, 0, 2], [2, 0, 2]]), (batch.num_envs, 1)), mask=mask)

        def observe(self, batch):
            return batch.lidar().ranges.reshape(batch.num_drones, 4)

    observation, _ = flockstep.DroneVectorEnv(2, drones_per_env=2, task=Idle, worlds=room).reset(seed=1)
    np.testing.assert_allclose(observation[:, 2], [2 - 0.465, 4] * 2, rtol=1e-6)
    alone, _ = flockstep.DroneVectorEnv(2, drones_per_env=2, task=Idle, worlds=room, interaction="none").reset(seed=1)
    np.testing.assert_allclose(alone[:, 2], [6, 4] * 2, rtol=1e-6)


def test_pictures_show_each_drone_once(room):
    """Views from outside draw drones themselves; what the drones see of each other does not change them."""
    keywords = {"worlds": room, "drones_per_env": 2, "render_mode": "rgb_array", "drone_mesh": RED}
    pictures = []
    for interaction in ("none", "sense"):
        envs = begun(
            1, **keywords, interaction=interaction, render_view=((-3, 0, 3), (1, 0, 2)), render_size=(80, 60), seed=1
        )
        envs.batch.set_pose(np.float32([[0, 0, 2], [1.5, 1, 3]]))  # the second is above the beams
        envs.batch.sense()
        pictures.append(envs.render()[0])
    np.testing.assert_array_equal(*pictures)


def test_the_camera_view_shows_the_others(room):
    camera = CameraConfig(width_px=64, height_px=48)
    keywords = {
        "worlds": room,
        "drones_per_env": 2,
        "render_mode": "rgb_array",
        "render_view": "camera",
        "interaction": "sense",
    }
    envs = begun(1, **keywords, camera=camera, drone_mesh=RED, seed=1)
    envs.batch.set_pose(np.float32([[0, 0, 2], [2, 0, 2]]))
    envs.batch.sense()
    seen, empty = envs.render()
    is_red = [(picture[:, :, 0] > 2 * picture[:, :, 1].astype(int)).sum() for picture in (seen, empty)]
    assert is_red[0] > 15 and is_red[1] == 0
