"""Memory: repeatedly made batches and environments release theirs, and a world of a million triangles is small."""

import ctypes
import gc
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import flockstep

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

DRONES = 1024
ROUNDS = 30
BATCH_BYTES = DRONES * 35 * 4 * 5  # of the ranges and both observation buffers: a lower bound for a batch
PAGE_BYTES = 4096
trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # of glibc


def resident_bytes():
    gc.collect()
    if trim is not None:
        trim(0)  # otherwise memory freed by earlier tests would be reused first
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE_BYTES


def growth(use: Callable[[], None]) -> int:
    """Return the growth of the process in bytes over ROUNDS rounds, after as many warm-up rounds."""
    for _ in range(ROUNDS):
        use()
    before = resident_bytes()
    for _ in range(ROUNDS):
        use()
    return resident_bytes() - before


def use_batch(world, num_threads):
    task, episode = flockstep.NavigationConfig(random_start=True), flockstep.EpisodeConfig(max_episode_steps=2)
    lidar = flockstep.LidarConfig()
    batch = flockstep.Batch([world], DRONES, lidar=lidar, task=task, episode=episode, num_threads=num_threads)
    batch.reset(np.arange(DRONES))
    for _ in range(3):
        batch.step(np.zeros(DRONES, int))
    batch.set_lidar(max_range_m=2.0)
    batch.restore(batch.snapshot())


def use_env(**arguments):
    env = flockstep.DroneVectorEnv(DRONES, num_threads=1, max_episode_steps=2, **arguments)
    env.reset(seed=0)
    for _ in range(3):
        env.step(env.action_space.sample())
    env.close()


def test_the_measure_sees_one_batch_kept_per_round(room):
    kept = []

    def leak():
        kept.append(flockstep.Batch([room], DRONES, lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig()))
        kept[-1].reset(np.arange(DRONES))

    # Not all of it, because fragments of free memory are reused first. The tests below allow no more than this.
    assert growth(leak) > ROUNDS * BATCH_BYTES // 4


@pytest.mark.parametrize("num_threads", [1, 2])
def test_batches(room, num_threads):
    assert growth(lambda: use_batch(room, num_threads)) < ROUNDS * BATCH_BYTES // 4


def test_threads_are_taken_over_from_batch_to_batch(room):
    """For every arena created, oneTBB's threads keep 7 KiB forever."""

    def use():
        for _ in range(20):
            flockstep.Batch([room], 128, lidar=flockstep.LidarConfig(beams=1), num_threads=2, block_size=1).sense()

    assert growth(use) < ROUNDS * 20 * 2048


def test_views_that_are_dropped_let_their_batch_go(room):
    def use():
        batch = flockstep.Batch([room], DRONES, lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig())
        batch.reset(np.arange(DRONES))
        view = batch.observation
        del batch
        assert np.isfinite(view).all()

    assert growth(use) < ROUNDS * BATCH_BYTES // 4


@pytest.mark.parametrize("copy", [False, True])
def test_envs(room, copy):
    assert growth(lambda: use_env(worlds=room, copy=copy)) < ROUNDS * BATCH_BYTES // 4


def test_envs_with_a_task_in_python(room, example):
    config, lidar = flockstep.NavigationConfig(), flockstep.LidarConfig()

    def use():
        use_env(worlds=room, task=example("navigation_numpy").Navigation(config, lidar))

    assert growth(use) < ROUNDS * BATCH_BYTES // 4


def test_worlds():
    """A world with its tree: 20,000 triangles of at least 36 bytes each."""
    i, j = np.meshgrid(np.arange(101), np.arange(101), indexing="ij")
    corner = (i * 101 + j)[:-1, :-1].ravel()
    scene = {
        "flockstep_scene": 1,
        "meshes": [
            {
                "vertices": np.stack([i, j, np.sin(i + j)], axis=-1).reshape(-1, 3).tolist(),
                "triangles": np.concatenate(
                    [np.stack([corner, corner + 101, corner + 102], 1), np.stack([corner, corner + 102, corner + 1], 1)]
                ).tolist(),
            }
        ],
    }

    def use():
        world = flockstep.World.from_dict(scene)
        assert world.raycast([[50, 50, 9]], [[0, 0, -1]], 20.0)["primitive"][0] >= 0

    for _ in range(3):
        use()
    grown = []
    for _ in range(3):  # a real leak recurs; a fragmented heap grows only sometimes
        before = resident_bytes()
        for _ in range(8):
            use()
        grown.append(resident_bytes() - before)
    assert min(grown) < 8 * 20_000 * 36 // 4


ROWS = 708  # rows of vertices, for a million triangles
TRIANGLES = 2 * (ROWS - 1) ** 2

# Prints the bytes that this adds to the process, at the end and at the peak.
LOOK = """
import json, re, sys, numpy as np, flockstep
def memory(what): return 1024 * int(re.search(what + r":\\s+(\\d+)", open("/proc/self/status").read())[1])
before = memory("VmRSS")
world = flockstep.World.load(sys.argv[1])
batch = flockstep.Batch([world], lidar=flockstep.LidarConfig(), cameras=[flockstep.CameraConfig()], num_threads=1)
batch.set_pose(np.float32([[0, 0, 8]]))
batch.sense()
print(json.dumps([memory("VmRSS") - before, memory("VmHWM") - before]))
"""


def test_a_million_triangles(tmp_path):
    builder = flockstep.WorldBuilder()
    along = np.arange(ROWS) / 12
    heights = (3 * np.sin(along)[:, None] + 3 * np.cos(0.8 * along)[None, :]).astype(np.float32)
    builder.heightfield(heights, builder.material("ground"), corner=(-200, -200), cell_m=400 / ROWS)
    path = tmp_path / "ground.glb"
    builder.build().save(path)
    run = subprocess.run([sys.executable, "-c", LOOK, path], check=True, stdout=subprocess.PIPE)
    resident, peak = json.loads(run.stdout)
    assert resident < 150 * TRIANGLES
    assert peak < 200 * TRIANGLES
