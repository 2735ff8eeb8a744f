"""The two experiments of the thesis "Drone Simulation Using Unreal Engine" as presets: tables 6.1 to 6.4.

>>> experiment = flockstep.thesis.lidar()
>>> model = flockstep.PPO("MlpPolicy", experiment.make_envs(), **experiment)
>>> model.learn(experiment.steps, progress_bar=True)
"""

from __future__ import annotations

from typing import Literal

from flockstep._core import CameraConfig, NavigationConfig, NavigationReward
from flockstep.trainings.presets import Preset
from flockstep.trainings.training import Keywords, Training

#: Common to the two tables of PPO; the rest are the defaults of Stable-Baselines3 and of `PPO`.
_SETTINGS: Keywords = {"n_steps": 2048, "gamma": 0.99, "clip_range": 0.2}


def _preset(env: str, steps: int, num_envs: int, learning_rate: float, envs: Keywords) -> Preset:
    keywords = {"max_episode_steps": None, "stagger_first_episode": False, **envs}
    settings = {**_SETTINGS, "learning_rate": learning_rate}
    return Preset(Training(env, steps, num_envs, settings, learns=lambda: keywords, falls=False))


def lidar(goal_norm: Literal["euclidean", "maximum"] = "euclidean") -> Preset:
    """Return the LiDAR experiment: tables 6.1 and 6.2, 40 drones in five playgrounds, 36,864,000 steps.

    Rewards are on the thesis's scale. Episodes never time out.

    Parameters
    ----------
    goal_norm
        Norm that is 1 in the observed direction to the goal. The text of the thesis normalises the vector
        (``"euclidean"``), its program divides by the largest component (``"maximum"``).
    """
    task = NavigationConfig(goal_norm=goal_norm, reward=NavigationReward(carry_over_distance=True))
    envs: Keywords = {"worlds": "train", "task": task}
    return _preset("flockstep/LidarNavigation-v0", 36_864_000, 40, 3e-4, envs)


def camera(width_px: int = 640) -> Preset:
    """Return the camera experiment: tables 6.3 and 6.4, 8 drones in two playgrounds, 4,400,000 steps.

    Parameters
    ----------
    width_px
        Width of the images in pixels; their height is three quarters of it. The default is the thesis's.
    """
    width_px = CameraConfig(width_px=width_px).width_px  # raises an error that names the argument
    images = CameraConfig(width_px=width_px, height_px=width_px * 3 // 4)
    envs: Keywords = {"worlds": "camera-train", "camera": images}
    return _preset("flockstep/CameraNavigation-v0", 4_400_000, 8, 1e-4, envs)
