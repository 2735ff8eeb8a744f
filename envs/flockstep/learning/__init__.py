"""A compiled PPO with the interface of Stable-Baselines3's."""

from flockstep.learning.ppo import PPO

__all__ = ["PPO"]
