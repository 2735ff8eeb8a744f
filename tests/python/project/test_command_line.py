"""The command ``flockstep``: its help is quick to import, and what every command has in common."""

import importlib.metadata
import json
import re
import subprocess
import sys

import pytest
from conftest import ROOT

from flockstep import __main__ as command
from flockstep import doctor

HEAVY = ("torch", "stable_baselines3", "matplotlib", "PIL", "scipy", "google.protobuf", "websockets", "mcap")


def ran(monkeypatch, capsys, *arguments):
    """Run the command in this process; return its exit status, standard output and standard error."""
    monkeypatch.setattr(sys, "argv", ["flockstep", *map(str, arguments)])
    try:
        command.main()
        status = 0
    except SystemExit as stop:
        status = stop.code
    return status, *capsys.readouterr()


def test_help_imports_no_commands_and_nothing_heavy():
    code = (
        "import sys\nfrom flockstep.__main__ import main\nsys.argv = ['flockstep', '--help']\n"
        f"try:\n    main()\nfinally:\n    print([name for name in {HEAVY} if name in sys.modules])\n"
        "    print([name for name in ('flockstep.trainings', 'flockstep.bridges', 'flockstep.identification', "
        "'flockstep.testing') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.splitlines()[-2:] == ["[]", "[]"], done.stdout + done.stderr
    listed = re.findall(r"^    (\w+)  ", done.stdout, re.MULTILINE)
    assert listed == list(command._COMMANDS)


@pytest.mark.parametrize("name", list(command._COMMANDS))
def test_every_command_has_a_help_without_torch(name):
    code = (
        f"import sys\nfrom flockstep.__main__ import main\nsys.argv = ['flockstep', '{name}', '--help']\n"
        "try:\n    main()\nfinally:\n    print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.startswith(f"usage: flockstep {name} ")
    assert done.stdout.endswith("False\n")


def test_the_script_is_installed():
    (script,) = importlib.metadata.entry_points(group="console_scripts", name="flockstep")
    assert script.load() is command.main
    assert f'flockstep = "{script.value}"' in (ROOT / "pyproject.toml").read_text()


def test_the_doctor_in_json(monkeypatch, capsys):
    monkeypatch.setattr(doctor, "report", lambda: [("flockstep", "1.2.3, in /a"), ("torch", 'missing: "\n')])
    status, out, _ = ran(monkeypatch, capsys, "doctor", "--json")
    assert (status, json.loads(out)) == (0, {"flockstep": "1.2.3, in /a", "torch": 'missing: "\n'})


def test_evaluate_in_json(monkeypatch, capsys):
    asked = ("evaluate", "hover", "controller", "--flights", "8")
    status, text, _ = ran(monkeypatch, capsys, *asked)
    _, out, _ = ran(monkeypatch, capsys, *asked, "--json")
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
def test_what_a_command_raises_is_a_line(monkeypatch, capsys, raised, status, text):
    def raise_it(*_):
        raise raised

    monkeypatch.setattr(doctor, "report", raise_it)
    assert ran(monkeypatch, capsys, "doctor") == (status, text, "")
