"""Includes only go downwards and imports form no cycles: a scan of the sources checks the layers."""

import ast
import graphlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT

from flockstep._core import engine_tasks

ENGINE = ROOT / "engine"
GENERATORS = ROOT / "scenes" / "generators"

# For each folder, the folders that its files may include. The list is exact: unused permissions are removed, and a new
# folder must be added.
ALLOWED: dict[str, set[str]] = {
    "base": set(),
    "world": {"base"},
    "formats": {"base", "world"},
    "imaging": {"base"},
    "trace": {"base", "world"},
    "collision": {"base", "trace", "world"},
    "render": {"base", "trace", "world"},
    "dynamics": {"base", "collision", "trace"},
    "prepared": {"base", "collision", "render", "trace", "world"},
    "bodies": {"base", "collision", "prepared", "render", "trace", "world"},
    "survey": {"base", "collision", "prepared", "trace", "world"},
    "planning": {"base", "bodies", "collision", "prepared", "survey", "world"},
    "generators": {"base", "planning", "world"},
    "sensors": {"base", "imaging", "prepared", "render", "trace", "world"},
}
# These may include all layers below them.
ALLOWED["tasks"] = set(ALLOWED)
ALLOWED["batch"] = set(ALLOWED)
ALLOWED["learning"] = {"base", "batch", "tasks"}
ALLOWED["recipe"] = set(ALLOWED)

# Public headers that expose a folder count as that folder. The others define plain types, which any folder may include.
FACES = {
    "world": "world",
    "drone_model": "world",
    "raycast": "survey",
    "survey": "survey",
    "planning": "planning",
    "world_report": "planning",
    "generators": "generators",
    "batch": "batch",
    "recipe": "recipe",
    "scenes": "recipe",
}

INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)


def includes(file: Path) -> Iterator[str]:
    yield from INCLUDE.findall(file.read_text())


def folder_of(include: str) -> str | None:
    """The folder of an include, or None for plain types."""
    folder, _, name = include.partition("/")
    return FACES.get(name.removesuffix(".hpp")) if folder == "flockstep" else folder


def sources(folder: Path) -> list[Path]:
    return sorted(file for file in folder.rglob("*") if file.suffix in {".cpp", ".hpp"})


def place_of(folder: str) -> Path:
    return GENERATORS if folder == "generators" else ENGINE / "src" / folder


def test_every_folder_has_its_place() -> None:
    assert {path.name for path in (ENGINE / "src").iterdir() if sources(path)} == set(ALLOWED) - {"generators"}


def test_the_allowed_arrows_go_one_way() -> None:
    """Permissions only point to earlier entries: the list is in the order of the layers."""
    seen: set[str] = set()
    for folder, below in ALLOWED.items():
        assert below <= seen, f"{folder} may include {sorted(below - seen)}, which stand above it"
        seen.add(folder)


@pytest.mark.parametrize("folder", ALLOWED)
def test_includes_go_downwards(folder: str) -> None:
    wrong, used = [], set()
    for file in sources(place_of(folder)):
        for include in includes(file):
            layer = folder_of(include)
            if layer in (None, folder) or include.endswith(".inc"):
                continue
            used.add(layer)
            if layer not in ALLOWED[folder]:
                wrong.append(f"{file.relative_to(ROOT)} includes {include}")
    assert not wrong
    if folder not in ("tasks", "batch", "recipe"):
        assert used == ALLOWED[folder], "allowed, but not needed"


def test_public_headers_show_no_internals() -> None:
    wrong = [
        f"{file.name} includes {include}"
        for file in sources(ENGINE / "include")
        for include in includes(file)
        if not include.startswith("flockstep/")
    ]
    assert not wrong


def python_modules() -> dict[str, Path]:
    """The Python modules of the package, of training/ and of tools/, by name."""
    modules = {}
    for base, package in ((ROOT / "envs", "flockstep"), (ROOT, "training"), (ROOT, "tools")):
        for file in (base / package).rglob("*.py"):
            modules[".".join(file.relative_to(base).with_suffix("").parts).removesuffix(".__init__")] = file
    return modules


def imported(tree: ast.Module) -> Iterator[str]:
    """Modules imported when a module is imported: not in functions, nor for type checkers."""
    nodes: list[ast.AST] = [tree]
    while nodes:
        node = nodes.pop()
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "modules import each other by their full names"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            nodes += node.orelse
        elif not isinstance(node, (ast.FunctionDef, ast.Lambda)):
            nodes += ast.iter_child_nodes(node)


def test_python_modules_import_each_other_in_no_circle() -> None:
    modules = python_modules()
    assert len(modules) > 50
    graph = {}
    for module, file in modules.items():
        names = set(imported(ast.parse(file.read_text())))
        # A name is a module or a member of one. The compiled module is not among these files.
        known = {name if name in modules else name.rpartition(".")[0] for name in names if name != "flockstep._core"}
        graph[module] = known & modules.keys() - {module}
    graphlib.TopologicalSorter(graph).prepare()  # raises CycleError, which contains the cycle


def test_the_env_neither_draws_nor_knows_a_task_of_the_engine() -> None:
    tree = ast.parse((ROOT / "envs" / "flockstep" / "vector_env.py").read_text())
    drawing = {name for name in imported(tree) if name.startswith(("flockstep.pictures.views", "flockstep.pictures.d"))}
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    assert not drawing
    assert not names & {config.__name__ for config in engine_tasks.values()}
