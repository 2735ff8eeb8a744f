"""``flockstep check``: the contract, the baselines and the speed of a task in a file."""

import json
import sys

import pytest

TASK = """
import numpy as np
from gymnasium import spaces
import flockstep

class Paid(flockstep.Task):
    worlds = "playground/train-1"
    observation_space = spaces.Box(-np.inf, np.inf, (3,), np.float32)
    max_episode_steps = 6
    step_m = 1e-6
    reward_terms = ("wage", "rent")

    def step(self, batch):
        wage = np.full(batch.num_drones, 1.0)
        return {"wage": wage, "rent": -0.25 * wage}, batch.contact.hit

    def observe(self, batch):
        return batch.position
"""


@pytest.fixture
def check(monkeypatch, command, tmp_path):
    """A function that checks the task of a text; it returns the exit status, standard output and standard error."""
    monkeypatch.setattr(sys, "path", list(sys.path))

    def run(text, *options, name=""):
        (tmp_path / "mine.py").write_text(text)
        return command("check", f"{tmp_path / 'mine.py'}{name}", *options)

    return run


def test_a_sound_task(check):
    status, out, _ = check(TASK, "--json", "--episodes", "3")
    found = json.loads(out)
    assert (status, set(found["contract"].values())) == (0, {None})
    for name in ("random", "zero"):
        flown = found["baselines"][name]
        assert (flown["episodes"], flown["episode_length"], flown["success_rate"]) == (3, 6, 0)
        assert flown["episode_return"] == pytest.approx(6 * 0.75)
        assert flown["episode_terms"] == pytest.approx({"wage": 6, "rent": -1.5})
    assert found["env_steps_per_s"] > 0
    assert found["action"].startswith("Box(-1.0, 1.0, (3,)")


def test_the_text_has_what_the_json_has(check):
    status, out, _ = check(TASK, "--episodes", "3")
    rows = dict(line.split(None, 1) for line in out.splitlines())
    assert status == 0
    assert (rows["determinism"], rows["autoreset"]) == ("ok", "ok")
    assert rows["wage"].split() == ["6", "6"]
    assert rows["rent"].split() == ["-1.5", "-1.5"]
    assert rows["3"].split("  ")[0] == "episodes"
    assert "env steps/s with 256 envs" in rows["speed"]


@pytest.mark.parametrize(
    ("before", "after", "failed", "words"),
    [
        ("return batch.position", "return batch.position + np.random.rand()", "determinism", "the same seed"),
        ("return batch.position", "return batch.position[:, :2]", "values", "Paid.observe"),
        ("return {", "return 1 / 0, {", "values", "ZeroDivisionError: division by zero (mine.py, line 15)"),
        (
            "wage = np.full(batch.num_drones, 1.0)",
            "wage = np.full(batch.num_drones, np.nan)",
            "values",
            "'wage' is nan",
        ),
    ],
)
def test_a_task_that_breaks_a_rule(check, before, after, failed, words):
    status, out, err = check(TASK.replace(before, after), "--episodes", "2")
    rows = dict(line.split(None, 1) for line in out.splitlines())
    assert (status, rows["spaces"], err) == (1, "ok", "")
    assert rows[failed].startswith("FAILED: ")
    assert words in rows[failed]


def test_several_tasks_need_a_name(check):
    both = TASK + "\nclass Unpaid(Paid):\n    pass\n"
    status, *_ = check(both)
    assert status.startswith("flockstep check: TASK: expected mine.py:NAME with one of Paid, Unpaid, got ")
    status, out, _ = check(both, "--episodes", "1", name=":Unpaid")
    assert (status, "speed" in out) == (0, True)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1", "expected a file with a flockstep.Task"),
        ("x = 1\nx.y", "mine.py raises AttributeError: 'int' object has no attribute 'y' (mine.py, line 2)"),
        ("import sys; sys.exit(3)", "mine.py raises SystemExit: 3 (mine.py, line 1)"),
        ("def :", "mine.py raises SyntaxError: invalid syntax"),
    ],
)
def test_files_without_a_task(check, text, words):
    status, out, _ = check(text)
    assert status.startswith("flockstep check: TASK: ")
    assert words in status
    assert out == ""


def test_worlds_of_a_task_that_declares_none(check):
    status, *_ = check(TASK.replace('worlds = "playground/train-1"', "worlds = None"))
    assert "declares no worlds" in status
    text = TASK.replace('worlds = "playground/train-1"', "worlds = None")
    status, out, _ = check(text, "--worlds", "playground/train-1", "playground/train-2", "--episodes", "1")
    assert (status, "FAILED" in out) == (0, False)
