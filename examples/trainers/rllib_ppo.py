"""Train on the LiDAR task with the PPO of Ray RLlib: its runners fly on one machine, or on all machines of a cluster.

build/ray/bin/python examples/trainers/rllib_ppo.py --runners 2
build/ray/bin/python examples/trainers/rllib_ppo.py --runners 8 --address 192.0.2.1:6379

`./dev test ray` makes build/ray. Without --address Ray is started on this machine for the time of the training.
"""

from dataclasses import dataclass
from typing import Any

import ray
import torch
import tyro
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis import ValueFunctionAPI
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.core.rl_module.torch import TorchRLModule
from torch import nn

from flockstep.rllib import configure
from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run, network
from processes import drones_of_each

AUTORESET = "next_step"  # RLlib begins an episode with the observation after a last step
LEARNING = {"train_batch_size_per_learner": 64 * NUM_ENVS, "minibatch_size": 4096, "num_epochs": 4, "lr": 3e-3}
LOSSES = {"gamma": 0.98, "lambda_": 0.95, "clip_param": 0.2, "entropy_coeff": 0.01, "vf_loss_coeff": 0.5}
UNUSED = {"vf_clip_param": float("inf"), "use_kl_loss": False}


@dataclass
class RLlibOptions(Options):
    """Learn to fly by LiDAR until the policy flies six of the seven playgrounds."""

    runners: int = 2
    """Processes that fly drones; 256 must be a multiple. Each needs a CPU of the cluster."""
    address: str | None = None
    """Address of a running cluster, as `ray start` prints it; default: start Ray here."""


class ActorCritic(TorchRLModule, ValueFunctionAPI):
    """The two networks of the other trainers."""

    def setup(self) -> None:
        """Make the networks."""
        self.actor, self.critic = network(6, gain=0.01), network(1, gain=1.0)

    def _forward(self, batch: dict[str, Any], **_: Any) -> dict[str, Any]:
        return {Columns.ACTION_DIST_INPUTS: self.actor(batch[Columns.OBS])}

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> torch.Tensor:
        """Return values (N,)."""
        return self.critic(batch[Columns.OBS]).squeeze(-1)


def main(options: RLlibOptions) -> nn.Module:
    """Train and return actor and critic."""
    run, drones = Run("ray", AUTORESET, options), drones_of_each(options.runners)
    ray.init(options.address or "local", include_dashboard=None if options.address else False)
    cpus = int(ray.cluster_resources().get("CPU", 0))
    if options.runners > cpus:
        raise SystemExit(f"--runners: expected at most {cpus}, the CPUs of the cluster, got {options.runners}")
    config = configure(PPOConfig(), ID, num_envs=drones, seed=options.seed * NUM_ENVS, **SETTINGS)
    config.env_runners(num_env_runners=options.runners)
    config.rl_module(rl_module_spec=RLModuleSpec(module_class=ActorCritic))
    config.training(grad_clip=0.5, grad_clip_by="global_norm", **LEARNING, **LOSSES, **UNUSED)
    algorithm = config.build_algo()
    module, flown = algorithm.get_module(), 0
    while run.goes_on(flown, lambda seen: module.actor(torch.from_numpy(seen)).argmax(1).numpy()):
        flown = int(algorithm.train()["env_runners"]["num_env_steps_sampled_lifetime"])
    algorithm.stop()
    ray.shutdown()
    return module


if __name__ == "__main__":
    main(tyro.cli(RLlibOptions))
