"""Train on the LiDAR task with the PPO of TorchRL, from steps that several processes collect.

.venv/bin/python examples/trainers/torchrl_collectors.py --workers 2
.venv/bin/python examples/trainers/torchrl_collectors.py --workers 2 --collector distributed
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import gymnasium
import torch
import tyro
from torch import nn
from torchrl.collectors import MultiSyncCollector
from torchrl.collectors.distributed import DistributedSyncCollector
from torchrl.envs import EnvBase, GymWrapper

from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run
from processes import drones_of_each, end_process, free_port, threads_of_each
from torchrl_ppo import AUTORESET, FRAMES, learn, make_actor


@dataclass
class CollectorOptions(Options):
    """Learn to fly by LiDAR until the policy flies six of the seven playgrounds."""

    workers: int = 2
    """Processes that fly drones; 256 must be a multiple."""
    collector: Literal["processes", "distributed"] = "processes"
    """Processes that share memory with the learner, or that send their steps by torch.distributed."""


def make_env(drones: int, seed: int, threads: int) -> EnvBase:
    """Return the drones of a worker."""
    torch.set_num_threads(1)  # of the worker: its network is small
    envs = gymnasium.make_vec(ID, drones, autoreset_mode=AUTORESET, num_threads=threads, **SETTINGS)
    env = GymWrapper(envs, categorical_action_encoding=True)
    env.set_seed(seed)
    return env


def workers(options: CollectorOptions) -> list[Callable[[], EnvBase]]:
    """Return what makes the drones of each worker; together they have the seeds of a single one."""
    drones, threads = drones_of_each(options.workers), threads_of_each(options.workers)
    seeds = range(options.seed * NUM_ENVS, (options.seed + 1) * NUM_ENVS, drones)
    return [partial(make_env, drones, seed, threads) for seed in seeds]


def main(options: CollectorOptions) -> nn.Module:
    """Train and return actor and critic."""
    run, actor, make = Run("torchrl", AUTORESET, options), make_actor(), workers(options)
    frames = {"frames_per_batch": FRAMES, "total_frames": FRAMES * (options.updates + 1)}
    plain = {"auto_register_policy_transforms": False}
    if options.collector == "processes":
        collector = MultiSyncCollector(
            make, actor, cat_results=0, use_buffers=True, update_at_each_batch=True, **frames, **plain
        )
    else:
        ways = {"launcher": "mp", "tcp_port": free_port()}  # the default port is the same for all trainings
        collector = DistributedSyncCollector(make, actor, collector_kwargs=plain, **ways, **frames)
    try:
        return learn(run, actor, collector)
    finally:
        for job in getattr(collector, "jobs", ()):  # they would go on until they have flown all frames
            job.terminate()
        collector.shutdown()


if __name__ == "__main__":
    main(tyro.cli(CollectorOptions))
    end_process()
