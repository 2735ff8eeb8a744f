"""Generates the pages of the environments from their tasks and spaces; --check only compares.

Writes the part between "<!-- environment ID -->" and "<!-- end of environment -->" of each page in docs/environments/,
and between "<!-- environments -->" and "<!-- end of environments -->" of docs/environments/index.md. Each id has a
page. Run it with the module built after a change of a task's words, fields or defaults.
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from stubs import field_table  # beside this file

import flockstep
from flockstep import _core

DOCS = Path(__file__).resolve().parents[1] / "docs"
INDEX = DOCS / "environments" / "index.md"
PAGE = re.compile(r"(<!-- environment (\S+) -->\n).*?(<!-- end of environment -->)", re.DOTALL)
LIST = re.compile(r"(<!-- environments -->\n).*?(<!-- end of environments -->)", re.DOTALL)


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


def paragraph(text: str) -> str:
    """Return a task's words as a paragraph of Markdown."""
    return textwrap.fill(markdown(text), 130, break_long_words=False, break_on_hyphens=False)


def markdown(text: str) -> str:
    """Return a task's words as Markdown: names in simple backquotes."""
    return re.sub(r"``|(?<!`)`(?!`)", "`", text)


def table(head: tuple[str, str], rows: list[tuple[str, str]]) -> list[str]:
    """Return a table of two columns."""
    cells = [(markdown(a), markdown(b)) for a, b in rows]
    return [
        f"| {head[0]} | {head[1]} |",
        "|---|---|",
        *("| " + " | ".join(x.replace("|", "\\|") for x in row) + " |" for row in cells),
    ]


class Environment:
    """An environment with its default arguments, and the text of its page."""

    def __init__(self, env_id: str) -> None:
        envs = gymnasium.make_vec(env_id, num_envs=1)
        made = envs.unwrapped
        assert isinstance(made, flockstep.DroneVectorEnv)
        recipe = made.recipe
        self.id, self.page = env_id, re.sub(r"(?<!^)(?=[A-Z])", "-", env_id.partition("/")[2][:-3]).lower()
        self.task: Any = next(config for config in _core.engine_tasks.values() if isinstance(recipe.task, config))
        self.observation = space_text(made.single_observation_space)
        self.action = space_text(made.single_action_space)
        self.defaults = {
            "`task`": f"`{self.task.__name__}`",
            "`worlds`": ", ".join(f"`{name}`" for name in recipe.worlds),
            "`drone`": f"`{made.batch.drone.name}`",
            "`motion`, `control`": f"`{recipe.dynamics.motion}`, `{recipe.dynamics.control}`",
            "drones of an env": str(made.batch.drones_per_env) if made.batch.drones_per_env > 1 else "",
            "`policy_hz`": f"{recipe.clock.policy_hz:g} steps per second",
            "`max_episode_steps`": f"{gymnasium.spec(env_id).max_episode_steps}",
            "`lidar`": ", ".join(lidar_text(config) for config in made.lidars),
            "`camera`": ", ".join(f"{c.width_px} x {c.height_px} pixels, {c.hfov_deg or 90:g}°" for c in made.cameras),
        }
        envs.close()

    def row(self) -> str:
        """Return the environment's row in the list of all."""
        cells = (f"[`{self.id}`]({self.page}.md)", self.task._about, self.observation, self.action)
        return "| " + " | ".join(cells) + " |"

    def text(self) -> str:
        """Return the generated part of the page."""
        words = self.task._words
        default = [(name, value) for name, value in self.defaults.items() if value]
        parts: list[tuple[str, str, list[str]]] = [
            ("", words["about"], []),
            ("Action", f"{self.action}. {words['action']}", []),
            (
                "Observation",
                f"{self.observation}. {words['observed']}",
                table(("numbers", "meaning"), words["observation"]),
            ),
            (
                "Reward",
                "The sum of these terms. `batch.reward_terms` has a column for each.",
                table(("term", "value"), [(f"``{term}``", value) for term, value in words["reward"]]),
            ),
            ("Start", words["start"], []),
            ("End", words["end"], []),
            (
                "Arguments",
                "Keywords of `DroneVectorEnv` and `gymnasium.make_vec` replace these defaults:",
                table(("argument", "default"), default),
            ),
            ("", f"The fields of `{self.task.__name__}` are keywords, too:", field_table(self.task._fields)),
        ]
        text = ""
        for title, said, rows in parts:
            text += f"\n## {title}\n" if title else ""
            text += f"\n{paragraph(said)}\n" + "".join(f"{row}\n" for row in ["", *rows] if rows)
        return text + "\n"


def pages() -> dict[Path, str]:
    """Return the text of each page, with its generated parts renewed."""
    found = [Environment(env_id) for env_id in sorted(gymnasium.registry) if env_id.startswith("flockstep/")]
    rows = ["| id | task | observation | action |", "|---|---|---|---|", *(env.row() for env in found)]
    listed = "\n".join(["", *rows, "", ""])
    texts = {INDEX: LIST.sub(lambda m: m[1] + listed + m[2], INDEX.read_text(encoding="utf-8"))}
    for env in found:
        path = DOCS / "environments" / f"{env.page}.md"
        old = path.read_text(encoding="utf-8")
        assert [m[2] for m in PAGE.finditer(old)] == [env.id], f"{path}: expected <!-- environment {env.id} --> once"
        texts[path] = PAGE.sub(lambda m, env=env: m[1] + env.text() + m[3], old)
    return texts


if __name__ == "__main__":
    from renew import renew  # beside this file

    renew(pages())
