"""Train on the LiDAR task with the PPO of Stable-Baselines3.

.venv/bin/python examples/trainers/sb3_ppo.py
"""

import tyro
from stable_baselines3 import PPO
from torch import nn

import flockstep
from lidar_task import ID, NUM_ENVS, SETTINGS, Options, Run

# The mode that make_vec uses: Stable-Baselines3 resets within the step. For bootstrapping it takes the last observation
# of a truncated episode from the infos (terminal_observation).
AUTORESET = "same_step"


def main(options: Options) -> nn.Module:
    """Train and return actor and critic."""
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
    envs.seed(options.seed * NUM_ENVS)  # PPO seeded them with options.seed, so consecutive runs would share seeds
    while run.goes_on(model.num_timesteps, lambda seen: model.predict(seen, deterministic=True)[0]):
        model.learn(64 * NUM_ENVS, reset_num_timesteps=False)  # one update
    return model.policy


if __name__ == "__main__":
    main(tyro.cli(Options))
