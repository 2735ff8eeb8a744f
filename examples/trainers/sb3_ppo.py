"""Learns the LiDAR task with PPO of Stable-Baselines3.

.venv/bin/python examples/trainers/sb3_ppo.py
"""

import tyro
from stable_baselines3 import PPO
from torch import nn

import flockstep
from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run

# What make_vec chooses: Stable-Baselines3 resets within the step and takes the last observation of an episode that was
# cut, which it bootstraps from, out of the infos (terminal_observation).
AUTORESET = "same_step"


def main(options: Options) -> nn.Module:
    """Train; return actor and critic."""
    run = Run("stable-baselines3", AUTORESET, options)
    envs = flockstep.sb3.make_vec(ID, NUM_ENVS, **SETTINGS)
    model = PPO(
        "MlpPolicy",
        envs,
        n_steps=64,
        batch_size=4096,
        n_epochs=4,
        learning_rate=3e-3,
        gamma=0.98,
        ent_coef=0.01,
        policy_kwargs={"features_extractor_class": flockstep.sb3.GoalFeatures},
        device="cpu",
        seed=options.seed,
    )
    envs.seed(options.seed * NUM_ENVS)  # PPO has seeded them with options.seed, which another run's would overlap
    while run.goes_on(model.num_timesteps, lambda seen: model.predict(seen, deterministic=True)[0]):
        model.learn(64 * NUM_ENVS, reset_num_timesteps=False)  # one update
    return model.policy


if __name__ == "__main__":
    main(tyro.cli(Options))
