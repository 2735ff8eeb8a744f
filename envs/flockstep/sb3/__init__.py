"""Stable-Baselines3: `make_vec` makes a `VecEnv` of N drones, `evaluate` and `success_rates` fly what was
trained.

>>> from stable_baselines3 import PPO
>>> envs = flockstep.sb3.make_vec("flockstep/LidarNavigation-v0", num_envs=256)
>>> model = PPO("MlpPolicy", envs, policy_kwargs={"features_extractor_class": flockstep.sb3.GoalFeatures})

`GoalFeatures`, `BlobFeatures`, `PixelFeatures` and `PointFeatures` are what a network sees of the built-in
observations; `ImageFeatures` is a small network for any observation with images. `LogTerms` logs what the reward is
made of, and `Progress` prints how far a training is, on a terminal and into files.
"""

from flockstep.sb3.evaluation import Evaluation, evaluate, success_rates
from flockstep.sb3.features import BlobFeatures, GoalFeatures, ImageFeatures, PixelFeatures, PointFeatures
from flockstep.sb3.log_terms import LogTerms
from flockstep.sb3.progress import Progress
from flockstep.sb3.vec_env import DroneVecEnv, make_vec

__all__ = [
    "BlobFeatures",
    "DroneVecEnv",
    "Evaluation",
    "GoalFeatures",
    "ImageFeatures",
    "LogTerms",
    "PixelFeatures",
    "PointFeatures",
    "Progress",
    "evaluate",
    "make_vec",
    "success_rates",
]
