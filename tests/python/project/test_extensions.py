"""Patches that extend the engine, and the number of files that they touch."""

import re
import subprocess
from pathlib import Path

import pytest
from conftest import ROOT

PATCHES = ROOT / "tests" / "extensions"


def touched(patch: Path) -> set[str]:
    """Return the files that a patch adds or changes."""
    return set(re.findall(r"^\+\+\+ b/(.*)$", patch.read_text(), re.MULTILINE))


@pytest.mark.parametrize(("name", "budget"), [("sensor", 3), ("array", 1), ("format", 2), ("task", 3)])
def test_an_extension_stays_within_its_budget_of_engine_files(name: str, budget: int) -> None:
    files = touched(PATCHES / f"{name}.patch")
    assert 1 <= len({file for file in files if file.startswith("engine/")}) <= budget
    others = {file for file in files if not file.startswith("engine/")}
    assert any(file.startswith("tests/engine/") for file in others), "it has a test"
    assert others <= {"bindings/config.cpp", *(file for file in others if file.startswith("tests/"))}


def test_every_patch_is_counted() -> None:
    assert {patch.stem for patch in PATCHES.glob("*.patch")} == {"sensor", "array", "format", "task"}


@pytest.mark.parametrize("patch", sorted(PATCHES.glob("*.patch")), ids=lambda patch: patch.stem)
def test_an_extension_applies(patch: Path) -> None:
    """`./dev try extensions` builds and runs them."""
    applied = subprocess.run(["git", "apply", "--check", patch], cwd=ROOT, capture_output=True, text=True, check=False)
    assert applied.returncode == 0, applied.stderr
