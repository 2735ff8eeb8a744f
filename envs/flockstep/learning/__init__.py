"""Compiled learners with the interface of Stable-Baselines3's PPO."""

from flockstep.learning.apg import APG
from flockstep.learning.callbacks import progress_of
from flockstep.learning.ppo import PPO

__all__ = ["APG", "PPO", "progress_of"]
