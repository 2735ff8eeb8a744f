"""Race for the board: environments, flights that judge a policy, and a controller to compare with.

.venv/bin/python -m training.race                  # the controller, on the bundled tracks
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

import flockstep
from training.tasks import CHOOSING_SEEDS, TRAINING_SEEDS, UNSEEN_SEEDS

Array = npt.NDArray[Any]
Predict = Callable[[Array], Array]

LAPS = 3
MOST_STEPS = 3000  # of a flight that judges: one minute
TRACKS = 300  # for training
NARROWER_M = 0.15  # of the gates in training
#: The recipe, found with the seeds 100 to 109 and start seeds from `CHOOSING_SEEDS`.
NUM_ENVS, STEPS, UNSEEN_STEPS = 512, 11_000_000, 11_000_000
SETTINGS: dict[str, Any] = {
    "n_steps": 32,
    "batch_size": 2048,
    "n_epochs": 4,
    "learning_rate": 2e-3,
    "policy_kwargs": {"log_std_init": -0.7},
}
#: Keywords of `flockstep.record`, and a view of the figure-8 from a corner of its hall.
FILM: dict[str, Any] = {
    "env": flockstep.RaceConfig(start="gate", laps=LAPS),
    "steps": MOST_STEPS,
    "max_episode_steps": MOST_STEPS,
}
VIEW = (-10.5, -8.5, 7.7), (0.5, 0.5, 1.0)


@dataclass(frozen=True)
class Race:
    """Flights of three laps, each from rest behind a random gate."""

    success: Array
    """(N,) bool: flew all laps."""
    crashed: Array
    """(N,) bool: ended by contact, a missed gate or too far away."""
    lap_s: float
    """Mean time of the laps after the first, which begins at rest, of successful flights; NaN without one."""
    speed_mps: float
    """Mean speed in these laps along the straight ways from gate to gate; NaN without one."""


def fly(predict: Predict, flights: int, seed: int, worlds: Any = "race/figure-8") -> Race:
    """Fly ``flights`` drones with consecutive seeds, in these worlds in turn."""
    task = flockstep.RaceConfig(start="gate", laps=LAPS)
    envs = flockstep.DroneVectorEnv(
        flights, task=task, worlds=worlds, max_episode_steps=MOST_STEPS, autoreset_mode="disabled", copy=False
    )
    observation, _ = envs.reset(seed=seed)
    gates, length_m = np.empty(flights, int), np.empty(flights)
    for env in range(flights):
        centers = np.array([gate["center"] for gate in envs.batch.world_of(env).gates])
        gates[env] = len(centers)
        length_m[env] = np.linalg.norm(np.roll(centers, -1, axis=0) - centers, axis=1).sum()
    success, crashed, flying = np.zeros(flights, bool), np.zeros(flights, bool), np.ones(flights, bool)
    first_lap = np.zeros(flights, int)  # steps
    steps = np.zeros(flights, int)
    for step in range(1, MOST_STEPS + 1):
        observation, _, terminated, truncated, _ = envs.step(predict(observation))
        first_lap[(envs.batch.task_state["passed"] >= gates) & (first_lap == 0)] = step
        ended = flying & (terminated | truncated)
        steps[ended], success[ended] = step, envs.batch.success[ended]
        crashed[ended] = terminated[ended] & ~success[ended]
        flying &= ~ended
        if not flying.any():
            break
    laps_s = (steps - first_lap)[success] * (1 / envs.batch.clock.policy_hz) / (LAPS - 1)
    envs.close()
    if not success.any():
        return Race(success, crashed, np.nan, np.nan)
    return Race(success, crashed, float(laps_s.mean()), float((length_m[success] / laps_s).mean()))


def make(
    num_envs: int, threads: int, worlds: Sequence[str | flockstep.World] = ("race/figure-8",), **keywords: Any
) -> flockstep.DroneVectorEnv:
    """Make the environments for training, with gates that are narrower than in the flights that judge."""
    return flockstep.DroneVectorEnv(
        num_envs,
        task=flockstep.RaceConfig(),
        worlds=[narrowed(world) for world in worlds],
        stagger_first_episode=True,
        autoreset_mode="same_step",
        copy=False,
        num_threads=threads,
        **keywords,
    )


def narrowed(world: str | flockstep.World) -> flockstep.World:
    """Return a world with narrower gates: a policy that is trained in them keeps away from the frames of others."""
    scene = flockstep.World.load(world).to_dict() if isinstance(world, str) else world.to_dict()
    for gate in scene["gates"]:
        gate["size"] -= NARROWER_M
    return flockstep.World.from_dict(scene)


def make_on_tracks(num_envs: int, threads: int) -> flockstep.DroneVectorEnv:
    """Make the environments for training on generated tracks, a random one in each episode."""
    return make(num_envs, threads, tracks(TRAINING_SEEDS, TRACKS), random_world=True)


def tracks(seeds: range, count: int) -> list[flockstep.World]:
    """Return the tracks of the first of these seeds."""
    return [flockstep.World.race_track(seed) for seed in seeds[:count]]


def fly_unseen(predict: Predict, flights: int, seed: int) -> Race:
    """Fly once on each of several generated tracks; their seeds are those of the flights."""
    return fly(predict, flights, seed, tracks(range(seed, seed + flights), flights))


class Pursuit:
    """A controller that flies through the next gate by a policy's observation, at about one speed.

    It aims at a point on the gate's axis, the closer to the gate the closer the drone is. From the desired acceleration
    follow the thrust and the direction of the drone's z axis, and from that the rates.

    Parameters
    ----------
    speed_mps
        Desired speed.
    config
        The task, for the scales of observation and actions.
    """

    GAIN = 3.0  # 1/s, from a difference in velocity to an acceleration
    TURN = 8.0  # 1/s, from an angle to an angular velocity
    AHEAD = 0.6  # distance of the aim before the gate, over that of the drone

    def __init__(self, speed_mps: float, config: flockstep.RaceConfig | None = None) -> None:
        self.speed_mps, self.config = speed_mps, config or flockstep.RaceConfig()

    def __call__(self, observation: Array) -> Array:
        """Return actions (N, 4) for observations (N, 25)."""
        scale = self.config.observation_scale
        offset, normal = observation[:, 0:3] / scale, observation[:, 3:6]
        own = observation[:, 6 * self.config.gates_ahead :]
        velocity, up = own[:, 0:3] / scale, own[:, 3:6]
        before = (offset * normal).sum(axis=1, keepdims=True)  # m along the axis to the gate's plane
        aim = offset - np.where(before > 0, self.AHEAD * before - 0.5, 2.0) * normal
        way = aim / np.maximum(np.linalg.norm(aim, axis=1, keepdims=True), 1e-6)
        force = self.GAIN * (self.speed_mps * way - velocity) / 9.81 + up  # over the weight
        thrust = np.linalg.norm(force, axis=1)
        direction = force / np.maximum(thrust, 1e-6)[:, None]
        actions = np.zeros((len(observation), 4), np.float32)
        most = self.config.max_thrust_to_weight
        along = np.maximum(force[:, 2], 0.0)
        actions[:, 0] = np.where(along > 1, (along - 1) / (most - 1), along - 1)
        roll, pitch = -direction[:, 1], direction[:, 0]  # the cross product of the z axis and the direction
        actions[:, 1], actions[:, 2] = self.TURN * roll / 8.0, self.TURN * pitch / 8.0
        actions[:, 3] = 2.0 * np.arctan2(offset[:, 1], offset[:, 0]) / 4.0
        return np.clip(actions, -1, 1)


SPEEDS_MPS = np.arange(2.0, 10.1, 0.5)


def chosen_pursuit(fly_it: Callable[[Predict, int, int], Race]) -> Pursuit:
    """Return the controller with the speed of the most successes on the choosing seeds; of equals the fastest."""
    rates = [fly_it(Pursuit(speed), 200, CHOOSING_SEEDS.start).success.mean() for speed in SPEEDS_MPS]
    return Pursuit(float(SPEEDS_MPS[np.flatnonzero(rates == np.max(rates))[-1]]))


def main(worlds: Sequence[str] = ("race/figure-8", "race/split-s", "race/warehouse")) -> None:
    """Print the results of the controller."""
    flights: list[tuple[str, Callable[[Predict, int, int], Race]]] = [
        (name, lambda predict, count, seed, name=name: fly(predict, count, seed, name))  # type: ignore[misc]
        for name in worlds
    ]
    for name, fly_it in [*flights, ("unseen tracks", fly_unseen)]:
        pilot = chosen_pursuit(fly_it)
        race = fly_it(pilot, 1000, UNSEEN_SEEDS.start)
        print(
            f"{name}: {race.success.mean():.1%} of 1000 flights, {race.lap_s:.2f} s a lap, {race.speed_mps:.1f} m/s, "
            f"by a controller with a desired speed of {pilot.speed_mps:g} m/s"
        )


if __name__ == "__main__":
    main()
