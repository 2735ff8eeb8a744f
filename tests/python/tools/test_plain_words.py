"""The counter of habits of prose."""

import pytest

from tools import plain_words

SOURCE = """\
// What it does. Two lines
// are one comment.
int x = 1'000;  // trailing
const char* a = "// no comment";  // likewise
"""


def test_comments_of_cpp() -> None:
    assert list(plain_words.cpp_comments(SOURCE)) == [
        (1, "What it does. Two lines are one comment."),
        (3, "trailing"),
        (4, "likewise"),
    ]


def test_comments_and_docstrings_of_python() -> None:
    text = 'def f():\n    """Return f."""\n    return "no prose"  # Of f.\n'
    assert sorted(plain_words.python_prose(text)) == [(2, "Return f."), (3, "Of f.")]


def test_strings_of_cpp() -> None:
    text = """f("one "
  "two", 'c', "three");  // "four"
const char* raw = R"(five
"six")";
"""
    assert list(plain_words.cpp_strings(text)) == [(1, "one two"), (2, "three"), (3, 'five\n"six"')]


def test_strings_of_python() -> None:
    text = '"""The module."""\nx = "one " "two"\ny = f"three {x!r} four"  # "five"\n'
    assert list(plain_words.python_strings(text)) == [(2, "one two"), (3, "three {} four")]


def test_prose_of_a_page() -> None:
    text = "One.\n```python\nlikewise = 1\n```\n<!-- test: 1 -> 2 -->\nTwo.\n"
    assert [line for line in plain_words.page_prose(text) if line[1]] == [(1, "One."), (6, "Two.")]


@pytest.mark.parametrize(
    ("file", "text", "expected"),
    [
        ("a.cpp", "Likewise for b, and likewise for c.", ['"likewise"']),
        ("a.cpp", "Of the world.", ['it begins with "Of"']),
        ("a.md", "What you need.", []),
        ("a.py", "Offsets of rows.", []),
    ],
)
def test_faults(file: str, text: str, expected: list[str]) -> None:
    assert plain_words.faults(file, text) == expected


def test_faults_of_strings() -> None:
    assert plain_words.faults("a.py", "Of the world, likewise.", is_string=True) == ['"likewise"']
    assert plain_words.faults("a.py", "What to do.", is_string=True) == []
    assert plain_words.faults("tools/plain_words.py", "likewise", is_string=True) == []
