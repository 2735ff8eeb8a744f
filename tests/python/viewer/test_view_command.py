"""``flockstep view``: pages from recordings, opened only where there is a display."""

import html
import os
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from test_recordings import flown, header_of, needs_page

pytestmark = needs_page


@pytest.fixture
def view(monkeypatch, command):
    """A function that runs the command; it returns the exit status, standard output and the opened addresses."""
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "CI"):
        monkeypatch.delenv(name, raising=False)
    return lambda *arguments: (*command("view", *arguments)[:2], opened)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Two recordings of different lengths, each as both kinds of file."""
    folder = tmp_path_factory.mktemp("files")
    for name, steps in (("a", 5), ("b", 9)):
        _, recording, _ = flown(steps=steps, num_envs=1)
        recording.save(folder / f"{name}.mcap")
        recording.save(folder / f"{name}.html")
    return folder


def steps_in(path):
    blocks = path.read_text().split('<script type="application/gzip"')[1:]
    return [header_of('<script type="application/gzip"' + block)[0]["steps"] for block in blocks]


def test_a_recording_becomes_a_page(view, files):
    out = files / "a.view.html"
    assert view(files / "a.mcap") == (0, f"{out}\n", [])
    assert header_of(out.read_text())[0] == header_of((files / "a.html").read_text())[0]


def test_a_page_is_opened_as_it_is(view, files, monkeypatch):
    before = sorted(files.iterdir())
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(sys, "platform", "linux")
    assert view(files / "a.html") == (0, f"{files / 'a.html'}\n", [(files / "a.html").as_uri()])
    assert sorted(files.iterdir()) == before


@pytest.mark.parametrize("kinds", [(".mcap", ".mcap"), (".html", ".mcap"), (".html", ".html")])
def test_two_of_any_kind_become_one_page(view, files, tmp_path, kinds):
    out = tmp_path / "both.html"
    assert view(files / f"a{kinds[0]}", files / f"b{kinds[1]}", "--out", out) == (0, f"{out}\n", [])
    assert steps_in(out) == [6, 10]


def test_two_flights_have_the_names_of_their_files(view, files, tmp_path):
    wrong = tmp_path / "<i>&quot;.mcap"
    shutil.copy(files / "b.mcap", wrong)
    view(files / "a.mcap", wrong, "--out", tmp_path / "both.html")
    names = re.findall(r'data-name="([^"]*)"', (tmp_path / "both.html").read_text())
    assert [html.unescape(name) for name in names] == ["a", "<i>&quot;"]
    view(tmp_path / "both.html", files / "a.mcap", "--out", tmp_path / "again.html")
    assert steps_in(tmp_path / "again.html") == [6, 6]


@pytest.mark.parametrize("suffix", [".mcap", ".html"])
def test_flights_in_different_worlds_are_shown_with_a_warning(command, files, tmp_path, suffix):
    _, elsewhere, _ = flown(steps=2, num_envs=1, worlds="arena/hall")
    elsewhere.save(tmp_path / f"hall{suffix}")
    status, out, said = command("view", files / "a.mcap", tmp_path / f"hall{suffix}", "--out", tmp_path / "two.html")
    assert (status, out) == (0, f"{tmp_path / 'two.html'}\n")
    assert "different worlds" in said
    assert "arena/hall" in said
    assert command("view", files / "a.mcap", files / "b.html", "--out", tmp_path / "two.html")[2] == ""


def test_a_page_of_two_gives_its_first(view, files, tmp_path):
    view(files / "b.mcap", files / "a.mcap", "--out", tmp_path / "both.html")
    view(tmp_path / "both.html", files / "a.html", "--out", tmp_path / "again.html")
    assert steps_in(tmp_path / "again.html") == [10, 6]


DENIED = "expected a file that you may read, got '{}'"


def denied(path):
    raise PermissionError(13, "Permission denied", str(path))


def test_what_is_no_recording_is_refused_before_a_page_is_written(command, files, tmp_path, monkeypatch):
    (tmp_path / "other.html").write_text("<script>1</script>")
    (tmp_path / "cut.html").write_bytes((files / "a.html").read_bytes()[:-20_000])
    (tmp_path / "noise.mcap").write_bytes(np.random.default_rng(0).bytes(5000))
    (tmp_path / "folder.html").mkdir()
    os.mkfifo(tmp_path / "pipe.html")  # opening one waits for a writer
    before = sorted(tmp_path.iterdir())
    refusals = {
        "other.html": "expected a page that replays a flight, got '{}'",
        "cut.html": "expected a page that replays a flight, got '{}'",
        "noise.mcap": "expected a recording of flockstep of format 1, got another file",
        "nothing.mcap": "expected a file, got '{}', which does not exist",
        "nothing.html": "expected a file, got '{}', which does not exist",
        "folder.html": "expected a file, got '{}', which is a directory",
        "pipe.html": "expected a file, got '{}', which is no file",
        "flight.txt": "expected a name that ends with .html or .mcap, got '{}'",
    }
    for name, said in refusals.items():
        path = tmp_path / name
        assert command("view", path) == (2, "", f"flockstep view: path: {said.format(path)}\n"[:200])
    monkeypatch.setattr(Path, "read_bytes", denied)  # root may read every file
    assert command("view", files / "a.html")[::2] == (
        2,
        f"flockstep view: path: {DENIED.format(files / 'a.html')}\n"[:200],
    )
    monkeypatch.undo()
    outs = {"page.txt": "a name that ends with .html", "a.html": "another file", "no/a.html": "a directory that exists"}
    for wrong, words in outs.items():
        status, _, said = command("view", files / "a.html", files / "b.html", "--out", files / wrong)
        assert status == 2
        assert words in said
    assert sorted(tmp_path.iterdir()) == before
    assert steps_in(files / "a.html") == [6]
