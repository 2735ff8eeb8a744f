"""Stable-Baselines3: `make_vec` makes a `VecEnv` of N drones, `evaluate` and `success_rates` test a trained policy.

>>> from stable_baselines3 import PPO
>>> envs = flockstep.sb3.make_vec("flockstep/LidarNavigation-v0", num_envs=256)
>>> model = PPO("MlpPolicy", envs, policy_kwargs={"features_extractor_class": flockstep.sb3.GoalFeatures})

`GoalFeatures`, `BlobFeatures`, `PixelFeatures` and `PointFeatures` are features extractors for the built-in
observations; `ImageFeatures` is a small network for any observation with images. `LogTerms` logs the terms of the
reward, and `Progress` prints the progress of a training on a terminal and into files.
"""

try:
    import stable_baselines3 as _  # noqa: F401
except ImportError as _error:
    _needed = f"flockstep.sb3 needs Stable-Baselines3 and PyTorch: pip install 'flockstep[sb3]' ({_error})"
    raise type(_error)(_needed, name=_error.name) from _error

from flockstep.evaluation import Evaluation, evaluate, success_rates
from flockstep.sb3.callbacks import LogTerms, Progress
from flockstep.sb3.features import (
    BlobFeatures,
    GoalFeatures,
    ImageFeatures,
    NormalizedFeatures,
    PixelFeatures,
    PointFeatures,
)
from flockstep.sb3.vec_env import DroneVecEnv, make_vec

__all__ = [
    "BlobFeatures",
    "DroneVecEnv",
    "Evaluation",
    "GoalFeatures",
    "ImageFeatures",
    "LogTerms",
    "NormalizedFeatures",
    "PixelFeatures",
    "PointFeatures",
    "Progress",
    "evaluate",
    "make_vec",
    "success_rates",
]
