"""Generates the tables of docs/environments.md from the registered environments; --check only compares.

Writes the part between "<!-- environments -->" and "<!-- end of environments -->". Run it with the module built after a
change of an environment's spaces or defaults.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

import flockstep

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "environments.md"
BEGIN, END = "<!-- environments -->\n", "<!-- end of environments -->\n"


def bound_text(values: Any) -> str:
    """Return a bound of a space: a number, or "mixed" if its elements differ."""
    return f"{values.flat[0]:g}" if np.all(values == values.flat[0]) else "mixed"


def space_text(space: spaces.Space[Any]) -> str:
    """Describe a space: "(38,) float32 in [-1, 1]"."""
    if isinstance(space, spaces.Discrete):
        return f"integer from 0 to {space.n - 1}"
    if isinstance(space, spaces.Dict):
        return "; ".join(f"`{name}`: {space_text(inner)}" for name, inner in space.spaces.items())
    assert isinstance(space, spaces.Box)
    low, high = bound_text(space.low), bound_text(space.high)
    limits = f" in [{low}, {high}]"
    if "mixed" in (low, high):
        limits = ", bounds differ by element"
    elif (low, high) == ("-inf", "inf"):
        limits = ", unbounded"
    return f"{space.shape} {space.dtype}{limits}"


def lidar_text(config: flockstep.LidarConfig) -> str:
    """Describe a LiDAR."""
    return f"{config.channels} x {config.beams} beams, {config.hfov_deg:g}°, {config.max_range_m:g} m"


def table(env_id: str) -> str:
    """Return the section of one environment."""
    envs = gymnasium.make_vec(env_id, num_envs=1)
    flown = envs.unwrapped
    assert isinstance(flown, flockstep.DroneVectorEnv)
    recipe = flown.recipe
    clock = recipe.clock
    rows = {
        "observation": space_text(flown.single_observation_space),
        "action": space_text(flown.single_action_space),
        "reward terms": ", ".join(f"`{name}`" for name in flown.batch.spec.reward_terms),
        "time limit": f"{gymnasium.spec(env_id).max_episode_steps} steps",
        "steps per second of flight": f"{clock.policy_hz:g}",
        "motion": f"`{recipe.dynamics.motion}`, commanded by `{recipe.dynamics.control}`",
        "drone": f"`{flown.batch.drone.name}`",
        "worlds": ", ".join(f"`{name}`" for name in recipe.worlds),
        "LiDAR": ", ".join(lidar_text(config) for config in flown.lidars),
        "camera": ", ".join(f"{c.width_px} x {c.height_px} pixels, {c.hfov_deg or 90:g}°" for c in flown.cameras),
    }
    lines = [f"| {name} | {text} |" for name, text in rows.items() if text]
    envs.close()
    return "\n".join([f"## `{env_id}`", "", "| | |", "|---|---|", *lines, ""])


def document_text(text: str) -> str:
    """Return the document with its tables regenerated."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    ids = sorted(name for name in gymnasium.registry if name.startswith("flockstep/"))
    return before + BEGIN + "\n" + "\n".join(table(name) for name in ids) + "\n" + END + after


if __name__ == "__main__":
    from renew import renew  # beside this file

    renew({DOCUMENT: document_text(DOCUMENT.read_text(encoding="utf-8"))})
