"""The counter of habits of prose, and the README's comparison with other simulators."""

import copy

import pytest
from messages import refused

from tools import peers_table, plain_words

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


CONTENT = {
    "peers": {"Peer": {"documentation": "https://peer.org"}},
    "rows": {"LiDAR": {"flockstep": "yes", "Peer": ["partly", "Peer 1.2.0"]}, "wind": {"flockstep": "yes"}},
}


def test_a_cell_without_text_is_a_dash():
    assert peers_table.table(CONTENT).splitlines()[2:] == ["| LiDAR | yes | partly |", "| wind | yes | \N{EN DASH} |"]


@pytest.mark.parametrize("cell", [["partly"], ["partly", "everybody knows"], ["partly", "https://peer.org", "Peer"]])
def test_a_cell_without_a_source_is_refused(cell):
    content = copy.deepcopy(CONTENT)
    content["rows"]["LiDAR"]["Peer"] = cell
    with refused(SystemExit, "peers.yaml: LiDAR, Peer", cell[1:]):
        peers_table.table(content)
