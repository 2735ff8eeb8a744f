"""Train on the LiDAR task with the PPO of skrl.

.venv/bin/python examples/trainers/skrl_ppo.py
"""

# ruff: noqa: D101, D102 - the methods are skrl's, documented there
from typing import Any

import gymnasium
import numpy as np
import torch
import tyro
from skrl import config
from skrl.agents.torch.ppo import PPO
from skrl.envs.wrappers.torch import wrap_env
from skrl.memories.torch import RandomMemory
from skrl.models.torch import CategoricalMixin, DeterministicMixin, Model
from skrl.trainers.torch import SequentialTrainer
from torch import nn

from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run, network

# skrl learns from every row, so no row may be a step that only begins an episode, as in next_step.
AUTORESET = "same_step"
LEARNING = {"rollouts": 64, "learning_epochs": 4, "mini_batches": 4, "learning_rate": 3e-3, "discount_factor": 0.98}
# Without time_limit_bootstrap the advantages of a truncated episode would leak into the next one.
LOSSES = {"entropy_loss_scale": 0.01, "value_loss_scale": 0.5, "value_clip": 0.0, "time_limit_bootstrap": True}
PPO_SETTINGS = {**LEARNING, **LOSSES, "experiment": {"write_interval": 0, "checkpoint_interval": 0}}  # no files
TRAINER_SETTINGS = {"timesteps": 64, "headless": True, "disable_progressbar": True, "close_environment_at_exit": False}


class Actor(CategoricalMixin, Model):
    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        CategoricalMixin.__init__(self)
        self.net = network(6, gain=0.01)

    def compute(self, inputs: dict[str, Any], role: str = "") -> tuple[torch.Tensor, dict[str, Any]]:
        return self.net(inputs["observations"]), {}


class Critic(DeterministicMixin, Model):
    def __init__(self, **spaces: Any) -> None:
        Model.__init__(self, **spaces)
        DeterministicMixin.__init__(self)
        self.net = network(1, gain=1.0)

    compute = Actor.compute


class FinalObservationPPO(PPO):
    """PPO that bootstraps a truncated episode from its own last observation, not from the first one of the next."""

    def record_transition(self, *, next_observations: torch.Tensor, infos: dict[str, Any], **others: Any) -> None:
        if "final_obs" in infos:
            ended = infos["_final_obs"]
            next_observations = next_observations.clone()
            next_observations[torch.as_tensor(ended)] = torch.as_tensor(np.stack(infos["final_obs"][ended]))
        super().record_transition(next_observations=next_observations, infos=infos, **others)


def main(options: Options) -> nn.Module:
    """Train and return actor and critic."""
    run = Run("skrl", AUTORESET, options)
    config.torch.key = options.seed * NUM_ENVS  # the wrapper's seed
    envs = wrap_env(gymnasium.make_vec(ID, NUM_ENVS, autoreset_mode=AUTORESET, **SETTINGS), verbose=False)
    spaces = {"observation_space": envs.observation_space, "action_space": envs.action_space, "device": "cpu"}
    actor, critic = Actor(**spaces), Critic(**spaces)
    memory = RandomMemory(memory_size=64, num_envs=NUM_ENVS, device="cpu")
    agent = FinalObservationPPO(models={"policy": actor, "value": critic}, memory=memory, cfg=PPO_SETTINGS, **spaces)
    trainer = SequentialTrainer(env=envs, agents=agent, cfg=TRAINER_SETTINGS)
    flown = 0
    while run.goes_on(flown, lambda seen: actor.net(torch.from_numpy(seen)).argmax(1).numpy()):
        trainer.train()  # continues: the wrapper resets a vector env only once
        flown += 64 * NUM_ENVS
    return nn.ModuleList([actor, critic])


if __name__ == "__main__":
    main(tyro.cli(Options))
