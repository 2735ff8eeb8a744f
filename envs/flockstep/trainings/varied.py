"""Trainings with drones that differ, and the same trainings without, judged by the same flights."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from flockstep._core import (
    ControllerConfig,
    DroneModel,
    DynamicsConfig,
    HoverConfig,
    ObservationConfig,
    RaceConfig,
    Variation,
    WindConfig,
    World,
)
from flockstep.trainings import flyers
from flockstep.trainings.flying import Flyer
from flockstep.trainings.training import UNSEEN_SEEDS, Array, Keywords, Training
from flockstep.variations import log_uniform, normal, uniform, vary

FRAMES = [name for name in DroneModel.names() if DroneModel.load(name).num_rotors == 4]
UNSEEN_FRAMES = [f"random/seed-{seed}" for seed in range(UNSEEN_SEEDS.start, UNSEEN_SEEDS.start + 1000)]
LATE: Keywords = {
    "variations": vary(action_delay_s=(0.0, 0.04)),
    "wind": WindConfig(gusts="dryden", mean_mps=(2.0, 0.0, 0.0)),
}
"""Commands up to 40 ms late, in a wind of 2 m/s with the gusts of 5 m/s at 6 m above the ground."""
MEMORY = ObservationConfig(history=2, past_actions=2)
LONGER_MEMORY = ObservationConfig(history=3, past_actions=2)
NARROWER_M = 0.15
"""How much narrower the gates are in training: a policy that learns in them keeps away from the frames of others."""
RACED = RaceConfig(start="gate", laps=3)
"""Race as policies are judged."""
QUICK = ControllerConfig(rate_gain_per_s=25.0, lead=1.0)
WIDTHS = (10, 20, 30, 40)
"""Percent by which each number of a racer may be off."""


class Held(flyers.PointError):
    """Distance to the point in the last steps, of which none may be over 5 cm, or over 20 cm; and the body's rate."""

    def __init__(self, envs: Any, steps: int, last: int) -> None:
        super().__init__(envs, steps, last, 1)
        self.turned = np.zeros(envs.num_envs)
        self.steps = steps

    def step(self, observation: Any, flying: Array) -> None:
        """Keep distances and rates."""
        super().step(observation, flying)
        if self._taken > self.steps - self.last:
            self.turned[flying] += 10.0 * np.linalg.norm(observation[flying, 9:12], axis=1) / self.last

    def values(self, steps: Array, success: Array) -> dict[str, Array]:
        """Return the errors, the successes by both limits, and the mean rate in rad/s."""
        last = self.distance[-self.last :]
        farthest = np.where(np.isnan(last).any(axis=0), np.inf, last.max(axis=0))
        return {
            **super().values(steps, success),
            "success": farthest <= 0.05,
            "within_20cm": (farthest <= 0.2).astype(float),
            "turn_radps": self.turned,
        }


@functools.cache
def turning_radps2(frame: str) -> float:
    """Return the largest angular acceleration about x of an airframe."""
    data = DroneModel.load(frame).to_dict()
    rotors = data["rotors"]
    thrust = np.polyval(rotors["thrust_n"][::-1], rotors["max_speed_radps"])
    return float(np.abs(np.array(rotors["position_m"])[:, 1]).sum() / 2 * thrust / data["inertia_kgm2"][0])


def many_frames() -> list[str]:
    """Return airframes to train with: a fifth bundled ones; of random ones, those that turn slowly several times."""
    drawn = [f"random/seed-{seed}" for seed in range(3000)]
    drawn = [frame for frame in drawn for _ in range(max(1, round(min(400 / turning_radps2(frame), 8))))]
    return FRAMES * (len(drawn) // 35) + drawn


def narrowed(world: World) -> World:
    """Return a race track with narrower gates."""
    scene = world.to_dict()
    for gate in scene["gates"]:
        gate["size"] -= NARROWER_M
    return World.from_dict(scene)


def every_number(width: float, **others: Any) -> list[Variation]:
    """Return laws that change each number of a drone by at most this share; inertia by stretching the mass."""
    names = ("mass", "arm", "thrust", "torque", "lag_up", "lag_down", "body_drag", "rotor_drag", "rate_gain")
    laws: dict[str, Any] = {f"{name}_scale": uniform(1.0 - width, 1.0 + width) for name in names}
    return vary(**{**laws, "stretch": uniform((1.0 - width) ** 0.5, (1.0 + width) ** 0.5), **others})


def _hover(crazyflie: bool) -> Keywords:
    several: Keywords = {
        "airframes": many_frames(),
        "variations": vary(
            mass_scale=(0.95, 1.05), action_delay_s=(0.0, 0.04), wind_mps=normal(0.0, 1.0, low=-3.0, high=3.0)
        ),
        "wind": WindConfig(gusts="dryden"),
    }
    return {
        "task": HoverConfig(crash_weight=30.0, start_tilt_deg=110.0, start_speed_mps=2.5, spin_weight=1.5),
        "control": "body_rates",
        "observed": MEMORY,
        "reward_scale": 0.1,
        **({} if crazyflie else several),
    }


def _thrown(flights: int, seed: int) -> Mapping[str, Keywords]:
    del flights, seed
    kinds: dict[str, Keywords] = {frame: {"drone": frame} for frame in FRAMES}
    kinds |= {"random": {"airframes": UNSEEN_FRAMES}}
    kinds |= {"late": {"airframes": FRAMES, **LATE}, "late_random": {"airframes": UNSEEN_FRAMES, **LATE}}
    same: Keywords = {"max_episode_steps": 301, "control": "body_rates", "observed": MEMORY}
    return {kind: {**same, **keywords} for kind, keywords in kinds.items()}


def _reports(kinds: list[str], *what: str) -> dict[str, tuple[str, str]]:
    return {f"{kind}/{each}": (kind, each) for kind in kinds for each in what}


_HOVER = Training(
    env="flockstep/Hover-v0",
    steps=16_000_000,
    num_envs=1024,
    settings={
        "n_steps": 32,
        "batch_size": 2048,
        "n_epochs": 5,
        "learning_rate": 1.6e-3,
        "gamma": 0.98,
        "policy_kwargs": {"log_std_init": -1.5},
    },
    judged=_thrown,
    measure=functools.partial(Held, steps=300, last=50),
    figures=_reports(
        [*FRAMES, "random", "late", "late_random"], "success", "within_20cm", "median_error_m", "turn_radps"
    ),
    baselines={"controller": [Flyer(flyers.position_control, {"control": "position"})]},
    film={"steps": 300, "control": "body_rates", "observed": MEMORY},
)


def raced(observed: ObservationConfig) -> Callable[[int, int], Mapping[str, Keywords]]:
    """Return the flights that judge a race policy with these observations, on drones alike and on others."""
    track: Keywords = {"task": RACED, "worlds": "race/figure-8", "max_episode_steps": 3000}
    track |= {"observed": observed}
    kinds = {
        "alike": track,
        "quick": {**track, "dynamics": DynamicsConfig(motion="rotors", control="body_rates", controller=QUICK)},
        **{str(percent): {**track, "variations": every_number(percent / 100)} for percent in WIDTHS},
    }
    return lambda flights, seed: kinds


_RACE = Training(
    env="flockstep/Race-v0",
    steps=30_000_000,
    num_envs=512,
    settings={
        "n_steps": 32,
        "batch_size": 2048,
        "n_epochs": 4,
        "learning_rate": 2e-3,
        "policy_kwargs": {"log_std_init": -0.7, "net_arch": [96, 96]},
    },
    judged=raced(LONGER_MEMORY),
    measure=functools.partial(flyers.Laps, laps=RACED.laps),
    figures=_reports(["alike", "quick", *map(str, WIDTHS)], "success", "lap_s"),
    baselines={"controller": [flyers.pursuit(float(speed)) for speed in np.arange(2.0, 10.1, 0.5)]},
    film={
        "task": RACED,
        "steps": 3000,
        "max_episode_steps": 3000,
        "observed": LONGER_MEMORY,
        "render_view": ((-10.5, -8.5, 7.7), (0.5, 0.5, 1.0)),
    },
)

TRAININGS: dict[str, Training] = {
    "hover_varied": replace(_HOVER, learns=lambda: _hover(False), bench=("hover_varied", "varied", 5)),
    "hover_alike": replace(_HOVER, learns=lambda: _hover(True), bench=("hover_varied", "alike", 5)),
    "race_varied": replace(
        _RACE,
        learns=lambda: {
            "worlds": [narrowed(World.load("race/figure-8"))],
            "variations": every_number(0.3, rate_gain_scale=log_uniform(0.7, 2.3)),
            "observed": LONGER_MEMORY,
        },
        bench=("race_varied", "varied", 5),
    ),
}
