"""Trainings by `flockstep.APG`, each beside the one by `flockstep.PPO` with the same flights to judge it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from flockstep._core import HoverConfig
from flockstep.trainings import varied
from flockstep.trainings.training import Keywords, Training
from flockstep.variations import vary

POINT: Keywords = {"policy_kwargs": {"features_extractor_class": "PointFeatures"}}
RACE: Keywords = {"learning_rate": 1e-2, "horizon": 60, "ticks": 2, "max_grad_norm": 0.3}


def by_gradients(row: Training, steps: int, settings: Keywords, label: str, **learns: object) -> Training:
    """Return a row that trains by `APG` in the environments of another row, apart from these keywords."""
    return replace(
        row,
        learner="APG",
        num_envs=32,
        steps=steps,
        settings=settings,
        learns=lambda: {**row.learns(), **learns},
        falls=False,
        bench=("gradients", label, 5),
    )


def frame_row(hover: Training, drone: str) -> Training:
    """Return a row that hovers one airframe by its rotor thrusts."""
    settings = {**POINT, "learning_rate": 3e-3, "ticks": 2}
    row = by_gradients(hover, 614_400, settings, f"frame_{drone}", drone=drone)
    return replace(row, judged=lambda flights, seed: {"": {"drone": drone}})


def _thrown(flights: int, seed: int) -> Mapping[str, Keywords]:
    kinds = varied.TRAININGS["hover_varied"].judged(flights, seed).items()
    return {
        kind: {name: value for name, value in keywords.items() if name != "observed"}
        for kind, keywords in kinds
        if not kind.startswith("late")
    }


def rows(trainings: Mapping[str, Training]) -> dict[str, Training]:
    """Return the rows by name, from those by `PPO`."""
    made = {
        "hover_apg": by_gradients(trainings["hover"], 307_200, {**POINT, "learning_rate": 1e-2}, "hover"),
        "track_apg": by_gradients(trainings["track"], 999_424, {**POINT, "learning_rate": 1e-2}, "track"),
        # Without the cap: as fast as its weights allow.
        "race_apg": by_gradients(trainings["race"], 1_998_720, RACE, "race", speed_cap_mps=(16.0, 16.0)),
        "race_unseen_apg": by_gradients(
            trainings["race_unseen"], 3_999_360, RACE, "race_unseen", speed_cap_mps=(8.0, 8.0)
        ),
    }
    made |= {f"hover_{drone}_apg": frame_row(trainings["hover"], drone) for drone in varied.FRAMES}
    frames = varied.TRAININGS["hover_varied"]
    kept = {name: figure for name, figure in frames.figures.items() if not name.startswith("late")}
    made["frames_apg"] = replace(
        by_gradients(frames, 2_000_000, {"learning_rate": 3e-3, "ticks": 2}, "frames"),
        num_envs=64,
        learns=lambda: {
            "task": HoverConfig(start_tilt_deg=110.0, start_speed_mps=2.5),
            "control": "body_rates",
            "airframes": varied.many_frames(),
            "variations": vary(mass_scale=(0.95, 1.05)),
        },
        judged=_thrown,
        figures=kept,
    )
    return made
