"""A batch has its own threads and serves one caller at a time."""

import os
import threading

import numpy as np
import pytest

import flockstep


def test_two_threads_in_one_batch_get_an_error_and_no_harm():
    world = flockstep.World.load("playground/train-1")
    batch = flockstep.Batch(
        [world], 512, lidar=flockstep.LidarConfig(), task=flockstep.NavigationConfig(), num_threads=1
    )
    batch.reset(np.arange(512))
    calls = [
        lambda: batch.step(np.zeros(512, int)),
        lambda: batch.set_lidar(hfov_deg=90.0),
        lambda: batch.restore(batch.snapshot()),
        lambda: batch.lidar().points,
        lambda: batch.remove([3]),
        lambda: batch.spawn([3], [[1, 1, 1]]),
        batch.sense,
    ]
    refused = []
    start = threading.Barrier(4)

    def use(seed):
        rng = np.random.default_rng(seed)
        start.wait()
        for _ in range(300):
            try:
                calls[rng.integers(len(calls))]()
            except RuntimeError as error:
                refused.append(str(error))
            except ValueError:
                pass  # with or without a drone of this index

    threads = [threading.Thread(target=use, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert refused
    assert set(refused) == {"this Batch is in use by another thread: one call at a time"}
    batch.reset(np.arange(512))
    batch.step(np.zeros(512, int))
    assert np.isfinite(batch.observation).all()


def test_more_threads_than_processors_are_a_warning_and_nothing_else(room, capfd):
    count = os.cpu_count() + 6
    with pytest.warns(RuntimeWarning, match=rf"num_threads={count}: this process may run on \d+ processors") as caught:
        batch = flockstep.Batch([room], 256, lidar=flockstep.LidarConfig(), num_threads=count, block_size=1)
    assert len(caught) == 1
    batch.sense()
    one = flockstep.Batch([room], 256, lidar=flockstep.LidarConfig(), num_threads=1)
    one.sense()
    np.testing.assert_array_equal(batch.lidar().ranges, one.lidar().ranges)
    assert capfd.readouterr().err == ""
