"""A compiled PPO with the interface of Stable-Baselines3's."""

from flockstep.learning.callbacks import progress_of
from flockstep.learning.ppo import PPO

__all__ = ["PPO", "progress_of"]
