"""The pictures of docs/: a page shows each, and the table of CONTRIBUTING.md has the command that makes it."""

import re
from fnmatch import fnmatch
from pathlib import Path

import pytest
from conftest import ROOT

DOCS = ROOT / "docs"
SUFFIXES = (".png", ".jpg", ".gif", ".webp", ".svg")
PICTURES = sorted(path for path in DOCS.rglob("*") if path.suffix in SUFFIXES)
SHOWN = re.compile(r"!\[[^\]]*\]\(([^)]+)\)")


def shown() -> set[Path]:
    """The pictures that the README and the pages of docs/ show."""
    pages = [ROOT / "README.md", *DOCS.rglob("*.md")]
    return {
        (page.parent / target).resolve() for page in pages for target in SHOWN.findall(page.read_text(encoding="utf-8"))
    }


def commands() -> dict[str, str]:
    """The commands of the table in CONTRIBUTING.md by the pattern of their pictures."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"^## Pictures\n(.*?)^## ", text, re.MULTILINE | re.DOTALL)
    rows = re.findall(r"^\| (`.+?`) \| `([^`]+)`.*\|$", table, re.MULTILINE)
    return {pattern: command for patterns, command in rows for pattern in re.findall(r"`([^`]+)`", patterns)}


def test_pages_show_every_picture_and_no_other() -> None:
    assert shown() == set(PICTURES)


@pytest.mark.parametrize("picture", PICTURES, ids=lambda path: path.name)
def test_one_command_makes_a_picture(picture: Path) -> None:
    name = picture.relative_to(DOCS).as_posix()
    assert len([pattern for pattern in commands() if fnmatch(name, pattern)]) == 1


@pytest.mark.parametrize(("pattern", "command"), commands().items(), ids=commands())
def test_a_row_has_pictures_and_a_program(pattern: str, command: str) -> None:
    assert any(fnmatch(path.relative_to(DOCS).as_posix(), pattern) for path in PICTURES)
    assert (ROOT / command.split()[0].replace(".", "/")).with_suffix(".py").is_file()
