"""Environments whose drones Betaflight flies, for policies that command thrust and body rates."""

from __future__ import annotations

from typing import Any

import numpy as np

from flockstep import stepping
from flockstep._core import ObservationConfig, Recipe, time_limit
from flockstep.bridges.betaflight import Array, BetaflightBridge
from flockstep.registration import make_any, make_same_step
from flockstep.task import Task
from flockstep.vector_env import DroneVectorEnv

#: Exchanges a second with the firmware, at least.
TICKS_HZ = 1000.0
_TIMED = ("battery_life_s", "dead_from_s")  # parameters


class BetaflightEnv:
    """Flies the steps of a `DroneVectorEnv` by Betaflight. ``make`` makes both.

    A step of this environment is ``ticks`` steps of the other one, each of one tick. The drones fly by the motors of
    the firmware, and the task scores and observes them. Its own step comes first and moves a drone by the built-in
    controller, from the same state for the same tick, but then the firmware's tick replaces this one. So what a policy
    observes lacks the change of the motors in the last tick: in a race at most 0.01 rad/s of roll and pitch, 0.15 of
    yaw, a millimetre per second and a micrometre. The batch's clock counts both ticks, so nothing may depend on it.

    Parameters
    ----------
    envs
        The environment: steps of one tick, autoreset disabled.
    ticks
        Ticks of a step.
    """

    def __init__(self, envs: DroneVectorEnv, ticks: int) -> None:
        batch = envs.batch
        task: Any = envs.task
        is_of_engine = hasattr(task, "_words") and not isinstance(task, Task)
        if batch.dynamics.control != "body_rates" or not is_of_engine:
            raise ValueError(
                'through: expected a task of the engine with control="body_rates", got '
                f'{type(task).__name__} with control="{batch.dynamics.control}"'
            )
        if envs.recipe.observed != ObservationConfig():
            raise ValueError(f"through: expected no memory and no late observations, got {envs.recipe.observed}")
        late = [law.parameter for law in batch.variations if law.parameter.startswith("action_")]
        if late:
            raise ValueError(f"through: expected commands that are in time, got variations of {', '.join(late)}")
        timed = [law.parameter for law in batch.variations if law.when == "interval" or law.parameter in _TIMED]
        timed += ["wind.gusts"] * (batch.dynamics.wind.gusts != "none") + ["bodies"] * (len(batch.bodies) > 0)
        if timed:
            raise ValueError(f"through: expected only what time does not change, got {', '.join(timed)}")
        self.envs, self.ticks = envs, ticks
        self.metadata = {**envs.metadata, "render_fps": max(1, round(batch.clock.policy_hz / ticks))}
        self.bridge = BetaflightBridge(batch)
        least, most = self.bridge.thrust_mps2
        most = min(most, 9.81 * getattr(task, "max_thrust_to_weight", np.inf))
        turns = np.radians([batch.dynamics.max_rate_dps] * 2 + [batch.dynamics.max_yaw_rate_dps])
        self._down = np.array([9.81 - least, *turns])
        self._up = np.array([most - 9.81, *turns])

    def __getattr__(self, name: str) -> Any:
        return getattr(self.envs, name)

    @property
    def recipe(self) -> Recipe:
        """The recipe of an environment with the same steps, which the built-in controller flies."""
        recipe = self.envs.recipe
        episode = recipe.episode  # a copy
        episode.frame_skip = self.ticks
        recipe.episode = episode
        return recipe

    def command(self, actions: Array) -> Array:
        """Return the commands (N, 4) of actions (N, 4), thrust over mass in m/s^2 and rates in rad/s."""
        actions = np.clip(np.asarray(actions, float), -1.0, 1.0)
        command = np.where(actions > 0.0, self._up, self._down) * actions
        command[:, 0] += 9.81
        return np.asarray(command)

    def reset(self, **keywords: Any) -> Any:
        """Begin new episodes, with firmwares that have just been armed."""
        result = self.envs.reset(**keywords)
        self.bridge.restart()
        return result

    def step(self, actions: Array) -> Any:
        """Fly one step; drones whose episode ends stay where they are, with their flags."""
        batch = self.envs.batch
        sticks = self.bridge.sticks_for(self.command(actions))
        for _ in range(self.ticks):
            before, signals = batch.flown, self.bridge.motors(sticks)
            stepping.step(self.envs, actions)
            goes_on = ~(batch.terminated | batch.truncated)
            batch.flown = np.where(goes_on[:, None], before, batch.flown)
            batch.fly(signals * self.bridge.full_speed_radps, ticks=1, mask=goes_on, control="rotor_speeds")
        self.envs._flown(actions, self.ticks)
        return stepping.results(self.envs)

    def episode_infos(self, indices: Any = None) -> dict[str, Any]:
        """Return the statistics of episodes, their lengths in steps of this environment."""
        infos = self.envs.episode_infos(indices)
        infos["episode_length"] = -(-infos["episode_length"] // self.ticks)
        return infos

    def close(self) -> None:
        """End the firmwares too."""
        self.bridge.close()
        self.envs.close()


def make(caller: str, env: Any, num_envs: int, **keywords: Any) -> BetaflightEnv:
    """Make an environment by its id or from a task, with the keywords of `DroneVectorEnv`, flown by Betaflight."""
    usual = make_same_step(caller, env, 1, ends_stay=True, **keywords)
    hz, episode, limit = usual.batch.clock.policy_hz, usual.recipe.episode, time_limit(usual.task)
    usual.close()
    if episode.frame_skip != 1:
        raise ValueError(f"through: expected frame_skip=1, got {episode.frame_skip}")
    ticks = int(np.ceil(TICKS_HZ / hz - 1e-9))
    steps = limit if episode.max_episode_steps is None else episode.max_episode_steps
    keywords.update(policy_hz=hz * ticks, physics_hz=hz * ticks, max_episode_steps=ticks * steps)
    keywords.update(autoreset_mode="disabled")
    envs = make_any(env, num_envs, **keywords)
    try:
        return BetaflightEnv(envs, ticks)
    except BaseException:
        envs.close()
        raise
