"""The Python argument `tracer`: its effects, and outputs that do not depend on it."""

import gymnasium
import numpy as np
import pytest
from conftest import placed
from messages import refused

import flockstep
from flockstep import CameraConfig, LidarConfig, World, WorldPool

CAMERA = CameraConfig(width_px=32, height_px=24, outputs=["rgb", "depth"])
GRID = LidarConfig(channels=8, beams=180, hfov_deg=360, vfov_deg=30, max_range_m=20)
FAN = LidarConfig(max_range_m=8)


def envs_in(worlds, tracer, num_envs=6, lidar=GRID, **arguments):
    return flockstep.DroneVectorEnv(
        num_envs, worlds=worlds, camera=CAMERA, lidar=lidar, tracer=tracer, random_start=True, **arguments
    )


def fly(envs, steps=6, seed=5):
    """Return all observations and images."""
    seen = []
    envs.reset(seed=seed)
    for step in range(steps):
        envs.step([step % 4] * envs.num_envs)
        camera = envs.batch.camera()
        seen.append([envs.batch.lidar().ranges.copy(), camera.rgb.copy(), camera.depth.copy()])
    return seen


@pytest.fixture(scope="module")
def office():
    return World.office(4)


@pytest.mark.parametrize("name", ["LidarNavigation", "CameraNavigation", "CameraPixels", "Formation", "Dodge"])
def test_hardly_a_ray_of_the_bundled_tasks_goes_through_embree(name):
    """The counts that docs/concepts/why-fast.md states; only Dodge has moving meshes."""
    envs = gymnasium.make_vec(f"flockstep/{name}-v0", num_envs=4 if name.startswith("Camera") else 64).unwrapped
    envs.reset(seed=0)
    before, steps = envs.batch.embree_rays, 40
    for _ in range(steps):
        envs.step(envs.action_space.sample())
    scans = steps * len(envs.batch.position)
    share = (envs.batch.embree_rays - before) / scans
    assert 0 < share < 5 if name == "Dodge" else share == 0


def test_rays_through_embree_are_counted():
    builder = flockstep.WorldBuilder()
    stone = builder.material("stone", base_color=(0.5, 0.5, 0.5))
    builder.box((5, 0, 1), (1, 1, 1), stone)
    builder.heightfield(np.zeros((30, 30), np.float32), stone, corner=(-15, -15))
    world = builder.build()
    batch = flockstep.Batch([world], 10, lidar=LidarConfig(beams=35), num_threads=1, tracer="tiles")  # no slices
    batch.set_pose(np.tile([0, 0, 1], (10, 1)))
    for scans in (1, 2):
        batch.sense()
        # Packets of 8 rays; a drone's last packet is filled with rays of the next drone.
        assert (batch.embree_rays, batch.embree_packets) == (350 * scans, 44 * scans)
    camera = CameraConfig(width_px=64, height_px=64, shadows=True, outputs=("rgb", "depth"))
    pictures = placed([world], [[0, 0, 1]], cameras=[camera], num_threads=1)
    pictures.sense()
    sees_something = np.isfinite(pictures.camera().depth[0]).reshape(4, 16, 4, 16).any(axis=(1, 3))
    assert sees_something.sum() == 10  # the others see the sky
    # Towards the sun, from all pixels of the tiles that see something; the primary rays use tiles.
    assert pictures.embree_rays == sees_something.sum() * 16 * 16


def embree_rays_in_a_pool(tracer, lidar):
    """Return the count after a flight whose episodes ended and drew new worlds."""
    pool = WorldPool(lambda number: World.office(number % 2), size=2, fresh=1)
    envs = envs_in(pool, tracer, 3, lidar=lidar, max_episode_steps=3)
    first = envs.batch.world_of(0)
    fly(envs, steps=8)
    assert envs.batch.world_of(0) is not first
    return envs.batch.embree_rays


@pytest.mark.parametrize(
    ("tracer", "lidar"),
    [
        ("tiles", LidarConfig(channels=8, beams=176, hfov_deg=360, vfov_deg=30, max_range_m=20)),  # none is too narrow
        ("slices", FAN),
    ],
)
def test_a_pool_builds_its_trees_ahead(tracer, lidar):
    assert embree_rays_in_a_pool(tracer, lidar) == 0 < embree_rays_in_a_pool("embree", lidar)


@pytest.mark.parametrize("tracer", ["tiles", "slices"])
def test_a_snapshot_of_the_other_is_refused(office, tracer):
    ours, embree = envs_in(office, tracer), envs_in(office, "embree")
    ours.reset(seed=0)
    with refused(ValueError, "snapshot", "tracer"):
        embree.restore(ours.snapshot())


def test_wrong_names():
    with refused(ValueError, "tracer", "embree3"):
        flockstep.Batch([World.playground(0)], tracer="embree3")
    with refused(ValueError, "tracer", "gpu"):
        gymnasium.make_vec("flockstep/LidarNavigation-v0", num_envs=2, tracer="gpu")
    with refused(TypeError, "tracer", 3):
        flockstep.Batch([World.playground(0)], tracer=3)


class TestSlices:
    """Fans, which are traced as slices of the world."""

    @staticmethod
    def scanning(world, tracer, count=300, **arguments):
        """Return a batch at random places of a world, with any orientation, which has scanned."""
        batch = flockstep.Batch([world], count, tracer=tracer, **{"lidar": FAN} | arguments)
        turns = np.random.default_rng(2).normal(size=(count, 4))
        turns[: count // 2, 1:3] *= 0.05  # half of them are nearly level
        turns /= np.linalg.norm(turns, axis=1, keepdims=True)
        batch.set_pose(world.free_places(count, seed=1), np.float32(turns))
        batch.sense()
        return batch

    @pytest.mark.parametrize(
        ("beams", "hfov_deg", "max_range_m", "sliced"),
        [(6, 10, 5, True), (5, 10, 5, False), (35, 270, 7, True), (35, 270, 8, False)],
    )
    def test_fans_are_sliced_by_the_rule_that_the_documentation_of_tracer_states(
        self, office, beams, hfov_deg, max_range_m, sliced
    ):
        """At least 6 beams, at most 1 m apart at the end of their range."""
        fan = LidarConfig(beams=beams, hfov_deg=hfov_deg, max_range_m=max_range_m)
        assert (self.scanning(office, "auto", lidar=fan).embree_rays == 0) == sliced
        text = " ".join(flockstep.Batch.__doc__.split())
        assert "Fans of at least 6 beams that are at most 1 m apart" in text
