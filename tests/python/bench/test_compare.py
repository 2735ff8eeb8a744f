"""`./dev bench --against`: its rows, its arguments, and the exit status for different ratios."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from messages import message, refused

import compare
import compare_rows

FILE = Path(compare.__file__)


@pytest.fixture
def run(monkeypatch, tmp_path):
    """A function that runs the program with fake ratios: `rows` holds the ratios of each row, one per repeat."""

    def main(rows, *arguments, cannot_run=(), build_s=None):
        repeats = iter(range(10))

        def repeat(this, other, names, failures):
            failures |= dict.fromkeys(cannot_run, "no such call")
            number = next(repeats)
            return iter([(row, values[number]) for row, values in rows.items()])

        monkeypatch.setattr(compare, "repeat", repeat)
        monkeypatch.setattr(compare, "build_seconds", lambda this, other: build_s)
        return compare.main(["--against", str(checkout(tmp_path)), *arguments])

    monkeypatch.setattr(compare, "ROOT", checkout(tmp_path))
    return main


def checkout(folder):
    """Make a folder that looks like a checkout."""
    (folder / "pyproject.toml").write_text('name = "flockstep"\n')
    python = folder / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True, exist_ok=True)
    python.touch()
    return folder


def test_every_family_has_rows_and_every_row_a_name_of_its_own():
    names = [row for row, _ in compare.ROWS]
    assert len(set(names)) == len(names)
    assert compare.FAMILIES == ("step", "lidar", "camera", "tiles", "dynamics", "worlds")
    for family in compare.FAMILIES:
        listed = getattr(compare_rows, family.upper())
        assert listed
        assert [row for row, _ in listed] == [row for row in names if row.startswith(f"{family}/")]


def test_a_name_selects_a_family_a_row_or_a_group_of_rows():
    assert compare.is_selected("step/n1", ["step"])
    assert compare.is_selected("step/n1", ["lidar", "step/n1"])
    assert compare.is_selected("camera/gl/mesh1k/64x64x64", ["camera/gl"])
    assert not compare.is_selected("step/n16", ["step/n1"])
    assert not compare.is_selected("step/n1", [])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--against", ".", "stepp"], ("NAME", "stepp")),
        (["--against", ".", "step/n2"], ("NAME", "step/n2")),
        (["step"], ("--against", "none")),
        (["--against", ".", "--repeats", "0"], ("--repeats", 0)),
    ],
)
def test_bad_arguments_are_refused(arguments, said, capsys):
    with pytest.raises(SystemExit) as exit_:
        compare.main(arguments)
    assert exit_.value.code == 2
    error = " ".join(capsys.readouterr().err.split()).partition("error: ")[2]
    assert re.match(message(*said), error)


def test_a_folder_without_an_installed_package_is_refused(tmp_path):
    for text, missing in (('name = "flockstep"\n', ".venv"), ("", "pyproject.toml")):
        (tmp_path / "pyproject.toml").write_text(text)
        with refused(SystemExit, missing):
            compare.main(["--against", str(tmp_path)])


@pytest.mark.parametrize(
    ("rows", "status"),
    [
        ({"step/a": [1.0, 1.0, 1.0], "step/b": [0.97, 0.97, 0.97]}, 0),
        ({"step/a": [0.98, 0.979, 0.9]}, 1),  # the mean is over medians
        ({"step/a": [0.9801, 0.981, 0.9]}, 0),
        ({"step/a": [1.2, 1.2, 1.2], "step/b": [0.92, 0.929, 0.8]}, 1),  # below in every repeat
        ({"step/a": [1.2, 1.2, 1.2], "step/b": [0.92, 0.931, 0.8]}, 0),
        ({}, 2),
    ],
)
def test_a_low_mean_or_a_row_that_is_slower_in_every_repeat_fails(run, rows, status):
    assert run(rows) == status


def test_the_table_names_the_slower_rows_and_those_that_cannot_run(run, capsys):
    assert run({"step/a": [1.2, 1.2, 1.2], "step/b": [0.92, 0.929, 0.8]}) == 1
    lines = capsys.readouterr().out.splitlines()
    (slow,) = (line for line in lines if "in every repeat" in line)
    assert slow.split()[:6] == ["step/b", "0.920", "0.929", "0.800", "0.920", "below"]
    assert "geometric mean of 2 rows: 1.051" in lines[-1]
    assert run({"step/a": [1.0, 1.0, 1.0]}, cannot_run=["step/b"]) == 2
    assert "step/b: cannot be run: no such call" in capsys.readouterr().out


@pytest.mark.parametrize(("ours_s", "status"), [(90, 0), (104, 0), (106, 1)])
def test_a_build_may_take_a_twentieth_more(run, capsys, ours_s, status):
    assert run({}, "build", build_s=(ours_s, 100)) == status
    assert f"{100 / ours_s:6.3f}" in capsys.readouterr().out
    assert run({"step/a": [1.0] * 3}, build_s=None) == 0  # only if named
    assert run({"step/a": [1.0] * 3}, "build", "step", build_s=(50, 100)) == 0
    assert "geometric mean of 1 rows: 1.000" in capsys.readouterr().out  # without it


def test_a_worker_times_rows_and_says_what_it_cannot_run():
    """Test the process that runs in either checkout."""
    requests = [{"prepare": "step/n1"}, {"count": 20}, {"prepare": "step/none"}, {"count": 1}]
    done = subprocess.run(
        [sys.executable, FILE, "--worker", "flockstep"],
        input="".join(json.dumps(request) + "\n" for request in requests),
        capture_output=True,
        text=True,
        check=True,
    )
    once, many, *failed = map(json.loads, done.stdout.splitlines())
    assert 0 < once["seconds"] < 1 and 0 < many["seconds"] < 1
    assert "KeyError" in failed[0]["error"] and "AssertionError" in failed[1]["error"]


class Answering(compare.Checkout):
    """A checkout without a process, with prepared answers."""

    def __init__(self, root, answers):
        self.root, self.answers = root, answers

    def send(self, **request):
        pass

    def read(self):
        return self.answers.pop(0)


def test_a_row_that_one_checkout_refuses_leaves_no_answer_of_the_other():
    seconds = [{"seconds": 0.02}] * 3
    this, other = Answering("here", [{"error": "no such call"}, *seconds]), Answering("there", [*seconds, *seconds])
    with refused(compare.CannotRunError, "here", "no such call"):
        compare.row_ratio(this, other, "step/n1")
    assert len(this.answers) == 3 and len(other.answers) == 5


def test_each_row_of_a_process_that_has_ended_is_reported(tmp_path):
    this = compare.Checkout(checkout(tmp_path))
    this.python.write_text("#!/bin/sh\nexit 1\n")
    this.python.chmod(0o755)
    with this:
        this.process.wait()
        for row in ("step/n1", "step/n16"):
            with refused(compare.CannotRunError, "ended"):
                compare.row_ratio(this, this, row)


#: A replacement for a checkout's Python: records its arguments, works in a child for some seconds, and exits with a
#: status.
PYTHON = """#!/bin/sh
echo "$*" >>arguments
echo "$CMAKE_BUILD_PARALLEL_LEVEL at a time"
{python} -c 'import time
until = time.process_time() + {seconds}
while time.process_time() < until: pass'
exit {status}
"""


def building(folder, seconds, status):
    folder.mkdir()
    found = compare.Checkout(checkout(folder))
    found.python.write_text(PYTHON.format(python=sys.executable, seconds=seconds, status=status))
    found.python.chmod(0o755)
    return found


def test_builds_are_timed_with_all_their_processes(tmp_path):
    this, other = building(tmp_path / "this", 0.5, 0), building(tmp_path / "other", 0, 0)
    ours, theirs = compare.build_seconds(this, other)
    assert theirs > 0 and ours - theirs > 0.4
    (arguments,) = (tmp_path / "this" / "arguments").read_text().splitlines()
    assert arguments.startswith("-m pip wheel ")
    assert " --no-build-isolation " in arguments and " --config-settings=build-dir=" in arguments


def test_a_build_that_fails_is_reported_with_the_end_of_its_log(tmp_path):
    this, other = building(tmp_path / "this", 0, 0), building(tmp_path / "other", 0, 3)
    with refused(compare.CannotRunError, "other", "status 3", "1 at a time"):
        compare.build_seconds(this, other)
