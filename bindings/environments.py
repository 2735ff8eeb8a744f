"""Generates the pages of the environments from their tasks and spaces; --check only compares.

Writes the part between "<!-- environment ID -->" and "<!-- end of environment -->" of each page in docs/environments/,
and between "<!-- environments -->" and "<!-- end of environments -->" of docs/environments/index.md. Each id has a
page. If several environments have the same task, the one with the task's default configuration lists its reward and its
fields, and the others link to it. Run it with the module built after a change of a task's words, fields or defaults.
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

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
        return ", ".join(f"`{name}`: {space_text(inner)}" for name, inner in space.spaces.items())
    assert isinstance(space, spaces.Box)
    low, high = bound_text(space.low), bound_text(space.high)
    limits = f" in [{low}, {high}]"
    if "mixed" in (low, high):
        limits = ""  # they differ by element
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


def is_explained(field: Any, words: str) -> bool:
    """Return whether the words of a task name a field, and each of its choices if it has any."""
    choices = re.findall(r'"\w+"', field["type"])
    return f"``{field['name']}" in words and all(choice in words for choice in choices)


def defaults_text(fields: list[Any]) -> str:
    """Return the defaults of fields as keywords: "`laps=3`, `start='between'`"."""
    return ", ".join(f"`{field['name']}={field['shown'].removesuffix('.0')}`" for field in fields)


def field_table(fields: list[Any]) -> list[str]:
    """Return a table of fields with their descriptions."""
    return table(("field", "description"), [(f"`{f['name']}={f['shown']}`", f["about"]) for f in fields])


def changed(config: Any, fields: list[Any]) -> dict[str, Any]:
    """Return the fields that differ from the defaults."""
    default = type(config)()
    values = {field["name"]: getattr(config, field["name"]) for field in fields}
    return {name: value for name, value in values.items() if value != getattr(default, name)}


def configured(config: Any) -> str:
    """Return a configuration: its class, and the fields that differ from its defaults."""
    other = changed(config, config._fields).items()
    listed = (f"{name}={configured(value) if hasattr(value, '_fields') else repr(value)}" for name, value in other)
    return f"{type(config).__name__}({', '.join(listed)})"


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
        self.config: Any = recipe.task
        self.is_default = recipe.task == self.task()
        keywords: dict[str, Any] = dict(  # noqa: C408 # as users write them
            worlds=recipe.worlds[0] if len(recipe.worlds) == 1 else recipe.worlds,
            drone=made.batch.drone.name,
            motion=recipe.dynamics.motion,
            control=recipe.dynamics.control,
            policy_hz=recipe.clock.policy_hz,
        )
        for name, value in changed(recipe, _core._other_fields["BatchConfig"]).items():
            if not isinstance(value, list):  # of sensors, see below
                keywords |= changed(value, value._fields) if hasattr(value, "_fields") else {name: value}
        self.defaults = [] if self.is_default else [f"`task={configured(recipe.task)}`"]
        for name, value in keywords.items():
            self.defaults.append(f"`{name}={format(value, 'g') if isinstance(value, float) else repr(value)}`")
        self.defaults += [f"`lidar` with {lidar_text(config)}" for config in made.lidars]
        for c in made.cameras:
            self.defaults.append(f"`camera` with {c.width_px} x {c.height_px} pixels, {c.hfov_deg or 90:g}°")
        envs.close()

    def row(self) -> str:
        """Return the environment's row in the list of all."""
        about = self.task._about
        if not self.is_default:
            about = f"{about.removesuffix('.')}, with `observation={self.config.observation!r}`."
        return f"| [`{self.id}`]({self.page}.md) | {about} |"

    def is_observed(self, numbers: str) -> bool:
        """Return whether a row or a sentence of the observation belongs here: its choice, if it names one."""
        choice = re.search(r'"(\w+)"', numbers)
        return not choice or choice[1] == self.config.observation

    def text(self, main: str) -> str:
        """Return the generated part of the page. ``main``: a link to the page with the task's reward and fields."""
        words, fields = self.task._words, self.task._fields
        name = self.task.__name__
        weights = [f for f in fields if f["name"].endswith("_weight") and f["name"] in str(words["reward"])]
        named = [field for field in fields if field not in weights and is_explained(field, str(words))]
        others = [field for field in fields if field not in weights and field not in named]
        of_named = f": {defaults_text(named)}." if named else ":"
        action = re.sub(r"\. \w+ numbers, clipped to \[-1, 1\]", ", clipped", f"{self.action}. {words['action']}")
        observed = " ".join(each for each in re.split(r"(?<=\.) ", words["observed"]) if self.is_observed(each))
        observation = [(re.sub(r', "\w+"', "", a), b) for a, b in words["observation"] if self.is_observed(a)]
        reward = table(("term", "value"), [(f"``{term}``", value) for term, value in words["reward"]])
        parts: list[tuple[str, str, list[str]]] = [
            ("Action", action[0].upper() + action[1:], []),
            ("Observation", f"{self.observation}. {observed}", table(("numbers", "meaning"), observation)),
            ("Reward", "The sum of these terms:", reward),
            ("", f"Weights: {defaults_text(weights)}." if weights else "", []),
            ("Start", words["start"], []),
            ("End", words["end"], []),
            ("Arguments", f"{', '.join(self.defaults)}.", []),
            ("", f"Fields of `{name}`{of_named}", []),
            ("", "", field_table(others) if others else []),
        ]
        if self.is_default:
            parts.insert(0, ("", words["about"], []))
        else:
            same = f"Those of {main}, with the weights in `task` below."
            parts[2:6] = [("Reward, start and end", same, [])]
            parts[-2:] = [("", f"{main} lists the fields of `{name}`.", [])]
        text = ""
        for title, line, rows in parts:
            text += f"\n## {title}\n" if title else ""
            text += f"\n{paragraph(line)}\n" if line else ""
            text += "".join(f"{row}\n" for row in ["", *rows] if rows)
        return text + "\n"


def title(page: str) -> str:
    """Return the heading of a page."""
    return (DOCS / "environments" / f"{page}.md").read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")


def pages() -> dict[Path, str]:
    """Return the text of each page, with its generated parts renewed."""
    found = [Environment(env_id) for env_id in sorted(gymnasium.registry) if env_id.startswith("flockstep/")]
    rows = ["| id | task |", "|---|---|", *(env.row() for env in found)]
    listed = "\n".join(["", *rows, "", ""])
    texts = {INDEX: LIST.sub(lambda m: m[1] + listed + m[2], INDEX.read_text(encoding="utf-8"))}
    main = {env.task: f"[{title(env.page)}]({env.page}.md)" for env in found if env.is_default}
    for env in found:
        path = DOCS / "environments" / f"{env.page}.md"
        old = path.read_text(encoding="utf-8")
        assert [m[2] for m in PAGE.finditer(old)] == [env.id], f"{path}: expected <!-- environment {env.id} --> once"
        texts[path] = PAGE.sub(lambda m, env=env: m[1] + env.text(main[env.task]) + m[3], old)
    return texts


if __name__ == "__main__":
    from renew import renew  # beside this file

    renew(pages())
