"""Train on the LiDAR task with the PPO of TorchRL.

.venv/bin/python examples/trainers/torchrl_ppo.py
.venv/bin/python examples/trainers/torchrl_ppo.py --env gymenv
"""

from dataclasses import dataclass
from typing import Literal

import gymnasium
import torch
import tyro
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


def main(options: TorchRLOptions) -> nn.Module:
    """Train and return actor and critic."""
    run = Run("torchrl", "none" if options.env == "gymenv" else AUTORESET, options)
    env = make_env(options.env)
    env.set_seed(options.seed * NUM_ENVS)
    net = network(6, gain=0.01)
    logits = TensorDictModule(net, in_keys=["observation"], out_keys=["logits"])
    actor = ProbabilisticActor(logits, in_keys=["logits"], distribution_class=Categorical, return_log_prob=True)
    critic = ValueOperator(network(1, gain=1.0), in_keys=["observation"])
    advantage = GAE(gamma=0.98, lmbda=0.95, value_network=critic)
    losses = ClipPPOLoss(
        actor, critic, entropy_coeff=0.01, critic_coeff=0.5, loss_critic_type="l2", normalize_advantage=True
    )
    optimizer = torch.optim.Adam(losses.parameters(), lr=3e-3, eps=1e-5)
    collector = iter(
        Collector(env, actor, frames_per_batch=FRAMES, total_frames=-1, auto_register_policy_transforms=False)
    )
    flown = 0
    while run.goes_on(flown, lambda seen: net(torch.from_numpy(seen)).argmax(1).numpy()):
        data = next(collector)
        data = advantage(data).flatten()
        for _ in range(EPOCHS):
            for rows in torch.randperm(FRAMES).split(BATCH_SIZE):
                loss = losses(data[rows])
                optimizer.zero_grad()
                (loss["loss_objective"] + loss["loss_critic"] + loss["loss_entropy"]).backward()
                nn.utils.clip_grad_norm_(losses.parameters(), 0.5)
                optimizer.step()
        flown += FRAMES
    return nn.ModuleList([actor, critic])


if __name__ == "__main__":
    main(tyro.cli(TorchRLOptions))
