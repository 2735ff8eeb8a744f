"""The command ``flockstep``: its help is quick to import, and what every command has in common."""

import importlib.metadata
import json
import re
import subprocess
import sys

import pytest
from conftest import ROOT

from flockstep import doctor

COMMANDS = ["doctor", "check", "train", "evaluate", "record", "view", "fly", "serve", "ardupilot", "mcap", "identify"]
PARTS = ("flockstep.trainings", "flockstep.bridges", "flockstep.identification", "flockstep.testing")
HEAVY = ("torch", "stable_baselines3", "matplotlib", "PIL", "scipy", "google.protobuf", "websockets", "mcap")


def test_help_imports_no_command_and_nothing_heavy():
    code = f"""
import sys
from flockstep.__main__ import main
def shown(*arguments):
    sys.argv = ["flockstep", *arguments]
    try:
        main()
    except SystemExit as stop:
        assert stop.code == 0
shown("--help")
print([name for name in {(*HEAVY, *PARTS)} if name in sys.modules])
for name in {COMMANDS}:
    shown(name, "--help")
print("torch" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    first, rest = done.stdout.split("\n[]\n")
    assert re.findall(r"^    (\w+)  ", first, re.MULTILINE) == COMMANDS
    assert re.findall(r"^usage: flockstep (\w+) ", rest, re.MULTILINE) == COMMANDS
    assert rest.endswith("\nFalse\n")


def test_the_script_is_installed():
    (script,) = importlib.metadata.entry_points(group="console_scripts", name="flockstep")
    assert script.value == "flockstep.__main__:main"
    assert f'flockstep = "{script.value}"' in (ROOT / "pyproject.toml").read_text()


def test_the_doctor_in_json(monkeypatch, command):
    monkeypatch.setattr(doctor, "report", lambda: [("flockstep", "1.2.3, in /a"), ("torch", 'missing: "\n')])
    status, out, _ = command("doctor", "--json")
    assert (status, json.loads(out)) == (0, {"flockstep": "1.2.3, in /a", "torch": 'missing: "\n'})


def test_evaluate_in_json(command):
    asked = ("evaluate", "hover", "controller", "--flights", "8")
    status, text, _ = command(*asked)
    _, out, _ = command(*asked, "--json")
    found = json.loads(out)
    assert status == 0
    assert [found[name] for name in ("training", "policy", "flights")] == ["hover", "controller", 8]
    assert text.startswith(f"{found['success']:.1%} of 8 flights succeed, {found['crashed']:.1%} crash")


@pytest.mark.parametrize(
    ("raised", "status", "text"),
    [
        (ValueError("seed: expected x"), "flockstep doctor: seed: expected x", ""),
        (KeyboardInterrupt(), 130, ""),
    ],
)
def test_what_a_command_raises_is_a_line(monkeypatch, command, raised, status, text):
    def raise_it(*_):
        raise raised

    monkeypatch.setattr(doctor, "report", raise_it)
    assert command("doctor") == (status, text, "")
