"""A fact has few places: how many files written by hand may name a task, a sensor, an operation or a field.

The names come from the real registries. `places.json` lists those that stand in more files than a new one may. It may
only shrink; `PYTHONPATH=tests/python:tests/python/support python tests/python/project/test_places.py` lowers it. null:
a common word, such as "name", which is not counted. The same holds for files that are too long and folders that are too
full.
"""

import json
import re
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from conftest import ROOT

from flockstep import _core
from flockstep.client import protocol

KEPT = json.loads(Path(__file__).with_name("places.json").read_text(encoding="utf-8"))
CODE = ("engine", "bindings", "envs", "server", "training", "tools", "bench", "scenes")
MADE = re.compile(r"env_keywords|client/changes|learning/arguments|core\.pyi$")
#: How many files may name a new one.
BUDGET = {"task": 6, "sensor": 5, "operation": 3, "field": 2}
MOST_LINES, MOST_FILES = 500, 40
DATA = ("bench/results", "tests/fuzz/corpus")  # folders of which nobody reads a list


def listed(*patterns: str) -> list[str]:
    """Return the files of the checkout, new ones included, but none that git ignores."""
    command = ["git", "ls-files", "-co", "--exclude-standard", *patterns]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split()


@cache
def sources() -> dict[str, str]:
    """Return the texts of the files that are written by hand, tests and documents apart."""
    suffixes = (".hpp", ".cpp", ".py", ".pyi", ".proto")
    files = [name for name in listed(*CODE) if name.endswith(suffixes) and not MADE.search(name)]
    return {name: (ROOT / name).read_text(encoding="utf-8") for name in files if (ROOT / name).exists()}


@cache
def words() -> dict[str, set[str]]:
    """Return the files in which each word stands, and where it is a string, "word", or declared with a type, word:."""
    found: dict[str, set[str]] = {}
    for name, text in sources().items():
        declared = re.findall(r"(?<![\w.])\w+:(?= )", text) if name.endswith(".py") else []
        for word in {*re.findall(r"\w+", text), *re.findall(r'"\w+"', text), *declared}:
            found.setdefault(word, set()).add(name)
    return found


def fields() -> dict[str, list[str]]:
    """Return the patterns of each field of a configuration, which count where it is declared, not where it is read."""
    described = [*(config._fields for config in vars(_core).values() if hasattr(config, "_fields"))]
    described += list(_core._other_fields.values())
    names = {field["name"] for listed in described for field in listed if field["name"].isidentifier()}
    return {name: [f'"{name}"', f"{name}:"] for name in names}


def operations() -> dict[str, list[str]]:
    """Return the patterns of each operation of the server."""
    listed = protocol.Request.DESCRIPTOR.oneofs_by_name["operation"].fields
    names = {field.name: field.message_type.name for field in listed}
    return {name: [name, names[name]] if "_" in name else [f'"{name}"', names[name]] for name in names}


def sensors() -> dict[str, list[str]]:
    """Return the patterns of each kind of sensor: the fields of a batch whose configurations have a rate."""
    kinds = {re.sub(r"^Sequence\[(\w+)\]$", r"\1", field["type"]) for field in _core._other_fields["BatchConfig"]}
    configs = [getattr(_core, kind) for kind in kinds if hasattr(getattr(_core, kind, None), "_fields")]
    return {config.__name__: [config.__name__] for config in configs if "rate_hz" in config.__match_args__}


def tasks() -> dict[str, list[str]]:
    """Return the patterns of each task of the engine."""
    return {name: [config.__name__, f'"{name}"'] for name, config in _core.engine_tasks.items()}


REGISTRIES = {"task": tasks, "sensor": sensors, "operation": operations, "field": fields}


#: Folders in which a name counts: those of the surfaces. Of a task also the scripts that are its own, but not benches
#: and worlds, which choose among all tasks.
WHERE = {
    "task": ("engine/", "bindings/", "envs/", "server/", "training/", "tools/"),
    "sensor": ("engine/", "bindings/", "envs/", "server/"),
    "operation": ("server/", "envs/flockstep/client/"),
    "field": ("bindings/", "envs/"),
}
#: Files that use a name as programs of users do: rows of trainings and presets give values to fields, presets to all;
#: identification reads and writes drone files.
USERS = {
    "field": r"/trainings/|/identification/|flockstep/(thesis|variations)\.py",
    "sensor": r"/trainings/|flockstep/thesis\.py",
    "task": r"flockstep/(thesis|trainings/varied)\.py",
}


def places(kind: str) -> dict[str, set[str]]:
    """Return the files that name each one of a kind."""
    found = {}
    for name, patterns in REGISTRIES[kind]().items():
        files = {file for pattern in patterns for file in words().get(pattern, ())}
        found[name] = {
            file for file in files if file.startswith(WHERE[kind]) and not re.search(USERS.get(kind, "^$"), file)
        }
    return found


@pytest.mark.parametrize("kind", BUDGET)
def test_a_new_one_stands_in_few_files(kind: str) -> None:
    found = places(kind)
    assert len(found) >= 4, "the registry is empty"
    for name, files in found.items():
        allowed = KEPT[kind].get(name, BUDGET[kind])
        assert allowed is None or len(files) <= allowed, (
            f"{kind} {name}: at most {allowed} files may name it, not {sorted(files)}"
        )


def sizes() -> dict[str, int]:
    """Return the lines of each file and the files of each folder that are over their limit."""
    files = [name for name in listed() if (ROOT / name).exists()]
    code = [name for name in files if name.endswith((".hpp", ".cpp", ".py"))]
    lines = {name: (ROOT / name).read_text(encoding="utf-8").count("\n") for name in code}
    folders = Counter(str(Path(name).parent) for name in files if not name.startswith(DATA))
    over = {name: count for name, count in lines.items() if count > MOST_LINES}
    return over | {name: count for name, count in folders.items() if count > MOST_FILES}


def test_files_and_folders_are_small() -> None:
    found = sizes()
    grown = {name: count for name, count in found.items() if count > KEPT["size"].get(name, 0)}
    assert not grown, f"at most {MOST_LINES} lines in a file and {MOST_FILES} files in a folder: {grown}"
    assert KEPT["size"].keys() <= found.keys(), "gone: run this file, which lowers the list"
    assert len(KEPT["size"]) <= 20


@pytest.mark.parametrize("kind", BUDGET)
def test_the_list_only_shrinks(kind: str) -> None:
    assert KEPT[kind].keys() <= places(kind).keys(), "gone: run this file, which lowers the list"
    assert len(KEPT[kind]) <= {"task": 0, "sensor": 3, "operation": 21, "field": 41}[kind]


def test_a_copy_of_a_name_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    name, files = next((name, files) for name, files in places("sensor").items() if files)
    monkeypatch.setitem(words(), name, {*files, "envs/flockstep/a.py", "server/b.cpp"})
    assert len(places("sensor")[name]) == len(files) + 2


def lowered(kind: str) -> dict[str, int | None]:
    """Return the list without what has gone, and with the numbers that have fallen."""
    found = {name: len(files) for name, files in places(kind).items() if len(files) > BUDGET[kind]}
    kept = {name: count for name, count in KEPT[kind].items() if name in found}
    return {name: None if count is None else min(count, found[name]) for name, count in kept.items()}


if __name__ == "__main__":
    large = {name: min(count, KEPT["size"].get(name, 0)) for name, count in sizes().items()}
    text = json.dumps({kind: lowered(kind) for kind in BUDGET} | {"size": large}, indent=2)
    Path(__file__).with_name("places.json").write_text(f"{text}\n", encoding="utf-8")
