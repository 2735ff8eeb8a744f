"""Batches that grow: spawn() beyond the last slot, other resolutions, views of arrays that have moved."""

import gc
import json
import threading

import numpy as np
import pytest
from messages import refused

import flockstep

AT = [[2.0, 4.0, 2.0]]


def empty(room, drones_per_env=1, **arguments):
    return flockstep.Batch([room], 0, drones_per_env=drones_per_env, num_threads=1, **arguments)


@pytest.mark.parametrize("drones_per_env", [0, 1])
def test_a_batch_may_begin_without_drones(room, drones_per_env):
    camera = flockstep.CameraConfig(width_px=8, height_px=6, outputs=("rgb", "depth"))
    batch = empty(room, drones_per_env, lidar=flockstep.LidarConfig(beams=5), cameras=[camera])
    assert (batch.num_envs, batch.drones_per_env, batch.num_drones) == (1 - drones_per_env, drones_per_env, 0)
    assert batch.generation == 0
    batch.sense()
    batch.capture()
    batch.move(np.zeros((0, 3)))
    assert batch.position.shape == (0, 3)
    assert batch.tick.shape == (1 - drones_per_env,)
    assert batch.camera().rgb.shape == (0, 6, 8, 3)
    assert batch.lidar().directions.shape == (0, 1, 5, 3)
    assert batch.lidar().config.beams == 5
    assert repr(batch).startswith("<Batch: 0 drones in 1 world")
    batch.restore(batch.snapshot())
    with refused(ValueError, "indices (row 0)", 0):
        batch.remove([0])
    assert batch.spawn([0], AT).tolist() == [0]
    assert batch.generation == 1
    assert batch.lidar().ranges.shape == (1 + (drones_per_env == 0), 1, 5)
    assert np.isfinite(batch.camera().depth[0]).any()


def test_spawn_takes_indices_envs_or_positions(room):
    batch = empty(room, 0)
    assert batch.spawn(position=AT * 2).tolist() == [0, 1]
    assert batch.spawn(env=[0], position=AT).tolist() == [2]
    assert (batch.num_envs, batch.drones_per_env) == (1, 4)
    assert batch.active.tolist() == [True, True, True, False]
    batch.remove([1])
    spawned = batch.spawn(position=AT * 3)
    assert spawned.dtype == np.int64
    assert spawned.tolist() == [1, 3, 4]
    assert batch.spawn(env=np.zeros(0, int)).tolist() == []
    for arguments, said in [
        ({}, ["position", None]),
        ({"indices": [0], "position": AT, "env": [0]}, ["env", "an array"]),
        ({"env": [1], "position": AT}, ["env (row 0)", 1]),
        ({"env": [0], "position": AT * 2}, ["position", (1, 3)]),
        ({"position": AT, "quat_wxyz": [[1, 0, 0, 0]] * 2}, ["quat_wxyz", (1, 4)]),
        ({"indices": [1 << 40], "position": AT}, ["indices (row 0)", 1 << 20]),
        ({"indices": [99], "position": [[np.nan, 0, 0]]}, ["position (row 0)", "finite"]),
    ]:
        with refused(ValueError, *said):
            batch.spawn(**arguments)
    generation = batch.generation
    assert batch.spawn([6, 6], [[2, 4, 2], [1, 4, 2]]).tolist() == [6, 6]  # the last row counts
    assert batch.position[6].tolist() == [1, 4, 2]
    assert batch.generation == generation


def test_views_of_old_arrays_keep_their_values(room):
    camera = flockstep.CameraConfig(width_px=8, height_px=6)
    batch = flockstep.Batch([room], 1, lidar=flockstep.LidarConfig(), cameras=[camera], num_threads=1)
    batch.move(AT)
    batch.sense()
    views = [
        batch.position,
        batch.active,
        batch.tick,
        batch.contact.hit,
        batch.sensed_position,
        batch.lidar().ranges,
        batch.lidar().max_range_m,
        batch.camera().rgb,
        batch.camera().frame_step,
        *batch.sensor("lidar").values(),
    ]
    before = [view.copy() for view in views]
    for i in range(1, 20):
        batch.spawn([i], batch.position[:1])
        batch.move(np.full((i + 1, 3), [1.0, 4.0, 1.5]))
        batch.sense()
    assert batch.generation == 19
    assert np.allclose(batch.position, [1, 4, 1.5])
    for view, value in zip(views, before, strict=True):
        np.testing.assert_array_equal(view, value)
        with pytest.raises(ValueError, match="read-only"):
            view[...] = 0
    current = batch.position
    del batch
    gc.collect()
    assert np.allclose(current, [1, 4, 1.5])
    np.testing.assert_array_equal(views[0], before[0])


def test_lidars_and_cameras_change_their_resolution(room):
    camera = flockstep.CameraConfig(width_px=8, height_px=6)
    batch = flockstep.Batch([room], 2, lidar=flockstep.LidarConfig(), cameras=[camera], num_threads=1)
    batch.set_lidar([False, True], hfov_deg=90)
    batch.sense()
    lidar, front = batch.lidar(), batch.camera()
    batch.set_lidar(beams=7, channels=2, vfov_deg=20)
    assert batch.generation == 1
    with refused(RuntimeError, "not scanned yet"):
        _ = lidar.ranges
    assert lidar.config_of(0).hfov_deg == 270
    assert lidar.config_of(1).hfov_deg == 90
    assert lidar.config_of(1).vfov_deg == 20
    batch.set_camera(width_px=4, mask=[True, True])
    assert front.rgb.shape == (2, 6, 4, 3)
    assert front.frame_step.tolist() == [-1, -1]
    batch.sense()
    assert lidar.ranges.shape == (2, 2, 7)
    assert front.rgb.any()
    for call, said in [
        (lambda: batch.set_lidar([True, False], beams=3), ["mask", "all drones", "beams"]),
        (lambda: batch.set_camera([True, False], height_px=3), ["mask", "all drones", "height_px"]),
        (lambda: batch.set_lidar(channels=0), ["lidar.channels", 0]),
        (lambda: batch.set_camera(height_px=9000), ["camera.height_px", 9000]),
    ]:
        with refused(ValueError, *said):
            call()
    assert batch.generation == 2


def test_gl_goes_on_rendering(room):
    camera = flockstep.CameraConfig(width_px=32, height_px=24, outputs=("rgb", "depth"))
    at = np.array([[2.0, 4.0, 2.0], [1.0, 3.0, 1.5], [2.5, 5.0, 1.0]])
    grown, whole = (flockstep.Batch([room], n, cameras=[camera], camera_backend="gl", num_threads=1) for n in (1, 3))
    grown.spawn([0], at[:1])
    grown.spawn([1, 2], at[1:])
    whole.spawn([0, 1, 2], at)
    assert grown.camera_backend_report().startswith("gl")
    np.testing.assert_array_equal(grown.camera().rgb, whole.camera().rgb)
    np.testing.assert_array_equal(grown.camera().depth, whole.camera().depth)


@pytest.mark.parametrize("sizes", [{"num_envs": 0}, {"num_envs": 3, "drones_per_env": 0}])
def test_recipes_may_have_no_drones(sizes):
    recipe = flockstep.Recipe.from_json(json.dumps({"worlds": ["playground/train-1"], **sizes}))
    batch = flockstep.Batch.from_recipe(recipe)
    assert batch.num_drones == 0
    env = None if "drones_per_env" not in sizes else [1]
    assert batch.spawn(env=env, position=[[1, 1, 1]]).size == 1


def test_threads_read_arrays_while_they_move(room):
    batch = empty(room, 0)
    batch.spawn([0], AT)
    served = batch._served()
    ended = threading.Event()
    torn = []

    def read():
        while not ended.is_set():
            count, position, active = batch.num_drones, batch.position, batch.active
            if not (len(position) >= count and len(active) >= len(position) and np.isfinite(position).all()):
                torn.append((count, len(position), len(active)))
            batch.set_pose(mask=None)

    threads = [threading.Thread(target=read) for _ in range(2)]
    for thread in threads:
        thread.start()
    for _ in range(200):
        batch.spawn(position=AT)
    ended.set()
    for thread in threads:
        thread.join()
    served.end()
    assert not torn
    assert batch.active.sum() == 201
