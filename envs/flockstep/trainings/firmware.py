"""Trainings for the flight controller Betaflight, whose firmware flies the races that judge."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from flockstep._core import DynamicsConfig
from flockstep.trainings.gradients import RACE, by_gradients
from flockstep.trainings.training import Keywords, Training
from flockstep.variations import controllers

BY_BETAFLIGHT: Keywords = {
    "dynamics": DynamicsConfig(
        motion="rotors",
        control="body_rates",
        max_rate_dps=460.0,
        max_yaw_rate_dps=230.0,
        controller=controllers["betaflight"],
    )
}


def rows(race: Training) -> dict[str, Training]:
    """Return rows that train a race for Betaflight, from the row of the race."""

    def judged(flights: int, seed: int) -> Mapping[str, Keywords]:
        (same,) = race.judged(flights, seed).values()
        return {"firmware": {**same, "through": "betaflight"}, "preset": {**same, **BY_BETAFLIGHT}}

    ppo = replace(
        race,
        learns=lambda: {**race.learns(), **BY_BETAFLIGHT},
        judged=judged,
        over=("firmware",),
        figures={"lap_s": ("firmware", "lap_s"), "success_by_preset": ("preset", "success")},
        film={**race.film, **BY_BETAFLIGHT},
        flights=100,
        bench=("betaflight", "ppo", 5),
    )
    # The rate loop is quick: the derivatives need shorter ticks.
    apg = by_gradients(ppo, 1_399_680, {**RACE, "ticks": 4}, "apg", speed_cap_mps=(16.0, 16.0))
    return {"race_betaflight": ppo, "race_betaflight_apg": replace(apg, bench=("betaflight", "apg", 5))}
