"""Train on the LiDAR task with the PPO of TorchRL.

.venv/bin/python examples/trainers/torchrl_ppo.py
.venv/bin/python examples/trainers/torchrl_ppo.py --env gymenv
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import gymnasium
import torch
import tyro
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModule
from torch import nn
from torch.distributions import Categorical
from torchrl.collectors import Collector
from torchrl.envs import EnvBase, GymEnv, GymWrapper, SerialEnv
from torchrl.modules import ProbabilisticActor, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run, network

# GymWrapper rejects next_step and prefers disabled: it resets the finished envs with a mask.
AUTORESET = "disabled"
FRAMES, EPOCHS, BATCH_SIZE = 64 * NUM_ENVS, 4, 4096  # per update: steps, passes over them, rows of a minibatch


@dataclass
class TorchRLOptions(Options):
    """Learn to fly by LiDAR until the policy flies six of the seven playgrounds."""

    env: Literal["gymwrapper", "gymenv"] = "gymwrapper"
    """A GymWrapper around the vector env, or 16 single envs, each a GymEnv made by its id."""


def make_env(name: str) -> EnvBase:
    """Return the drones as a TorchRL environment."""
    if name == "gymenv":
        return SerialEnv(16, lambda: GymEnv(ID, categorical_action_encoding=True, **SETTINGS))
    envs = gymnasium.make_vec(ID, NUM_ENVS, autoreset_mode=AUTORESET, **SETTINGS)
    return GymWrapper(envs, categorical_action_encoding=True)


def make_actor() -> ProbabilisticActor:
    """Return the policy."""
    logits = TensorDictModule(network(6, gain=0.01), in_keys=["observation"], out_keys=["logits"])
    return ProbabilisticActor(logits, in_keys=["logits"], distribution_class=Categorical, return_log_prob=True)


def learn(run: Run, actor: ProbabilisticActor, collector: Iterable[TensorDictBase]) -> nn.Module:
    """Train with steps (N, T) from a collector; return actor and critic."""
    critic = ValueOperator(network(1, gain=1.0), in_keys=["observation"])
    advantage = GAE(gamma=0.98, lmbda=0.95, value_network=critic)
    losses = ClipPPOLoss(
        actor, critic, entropy_coeff=0.01, critic_coeff=0.5, loss_critic_type="l2", normalize_advantage=True
    )
    optimizer = torch.optim.Adam(losses.parameters(), lr=3e-3, eps=1e-5)
    flown, steps, net = 0, iter(collector), actor[0].module
    while run.goes_on(flown, lambda seen: net(torch.from_numpy(seen)).argmax(1).numpy()):
        data = advantage(next(steps)).flatten()
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(data)).split(BATCH_SIZE):
                loss = losses(data[rows])
                optimizer.zero_grad()
                (loss["loss_objective"] + loss["loss_critic"] + loss["loss_entropy"]).backward()
                nn.utils.clip_grad_norm_(losses.parameters(), 0.5)
                optimizer.step()
        flown += len(data)
    return nn.ModuleList([actor, critic])


def main(options: TorchRLOptions) -> nn.Module:
    """Train and return actor and critic."""
    run = Run("torchrl", "none" if options.env == "gymenv" else AUTORESET, options)
    env, actor = make_env(options.env), make_actor()
    env.set_seed(options.seed * NUM_ENVS)
    return learn(
        run,
        actor,
        Collector(env, actor, frames_per_batch=FRAMES, total_frames=-1, auto_register_policy_transforms=False),
    )


if __name__ == "__main__":
    main(tyro.cli(TorchRLOptions))
