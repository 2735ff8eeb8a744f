"""Trainings by `flockstep.APG`, each beside the one by `flockstep.PPO` with the same flights to judge it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from flockstep.trainings import varied
from flockstep.trainings.training import Keywords, Training
from flockstep.variations import Law, vary

POINT: Keywords = {"learning_rate": 1e-2, "policy_kwargs": {"features_extractor_class": "PointFeatures"}}
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


def frame_row(row: Training, drone: str) -> Training:
    """Return a row for another airframe."""
    settings = {**POINT, "learning_rate": 3e-3, "ticks": 2}
    made = by_gradients(row, 614_400, settings, f"frame_{drone}", drone=drone)

    def judged(flights: int, seed: int) -> Mapping[str, Keywords]:
        return {kind: {**keywords, "drone": drone} for kind, keywords in row.judged(flights, seed).items()}

    return replace(made, judged=judged)


def _thrown(flights: int, seed: int) -> Mapping[str, Keywords]:
    kinds = varied.TRAININGS["hover_varied"].judged(flights, seed).items()
    return {
        kind: {name: value for name, value in keywords.items() if name not in ("observed", "wind")}
        for kind, keywords in kinds
    }


def frames_row(label: str, **laws: Law) -> Training:
    """Return a row that holds all airframes and random ones by body rates, without a memory."""
    several = varied.TRAININGS["hover_varied"]
    made = by_gradients(several, 2_000_000, {"learning_rate": 3e-3, "ticks": 2}, label)

    def learns() -> Keywords:
        kept = {name: value for name, value in several.learns().items() if name in ("task", "control", "airframes")}
        return {**kept, "variations": vary(mass_scale=(0.95, 1.05), **laws)}

    return replace(made, num_envs=64, learns=learns, judged=_thrown, over=(*varied.FRAMES, "random"))
