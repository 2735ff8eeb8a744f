"""Counts how pages are written: ``python -m tools.pages [PAGE...]``. With ``--check`` it names what is over a limit.

A page's text is what stands outside of code blocks, tables, headings, comments and generated parts. Each kind of page
has a budget of words of text, by its directory. A span of code or a link counts as its words. All documents together
have a budget, too, in which everything counts, as by ``wc -w``.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
#: Words of text that a page may have, by the beginning of its path; the longest that fits counts.
BUDGETS = {
    "README.md": 900,
    "CONTRIBUTING.md": 1500,
    "SECURITY.md": 450,
    "docs/index.md": 250,
    "docs/tutorials/": 900,
    "docs/how-to/": 700,
    "docs/environments/": 500,
    "docs/reference/": 1200,
    "docs/concepts/": 1200,
    "docs/results/": 500,
    "docs/project/": 900,
    "docs/thesis/": 600,
}
#: Words that all documents together may have, tables, code and comments included.
TOTAL = 60_000
POINTERS_PER_1000 = 0.5
SEMICOLONS_PER_1000 = 3
LONG_SENTENCE = 30  # words
LONG_SHARE = 0.05

_POINTER = re.compile(r"\b(?:that|those) of\b", re.IGNORECASE)
_GENERATED = r"<!-- (?!test\b|tried\b|figure\b|/|end of).*?-->\n.*?<!-- (?:end of|/).*?-->"
_LEFT_OUT = re.compile(
    rf"^ *```.*?^ *```$|{_GENERATED}|<!--.*?-->|^#.*?$|^ *\|.*?$|^ *!\[.*?\]\(.*?\)$", re.MULTILINE | re.DOTALL
)
_LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
_ITEM = re.compile(r"^ *(?:[-*]|\d+\.) ", re.MULTILINE)
_END = re.compile(r"(?<=[.!?:])\s+(?=[\"'(*`A-Z0-9])")


class Page(NamedTuple):
    """The counts of one page."""

    path: str
    words: int
    pointers: list[str]
    semicolons: list[str]
    long: list[str]
    sentences: int


def paragraphs(text: str) -> Iterator[str]:
    """Yield each paragraph and list item of a page's text on one line, links as their words."""
    text = _LINK.sub(r"\1", _LEFT_OUT.sub("\n", text))
    for paragraph in re.split(r"\n\s*\n", _ITEM.sub("\n\n", text)):
        line = " ".join(paragraph.split())
        if line:
            yield line


def count(path: str, text: str) -> Page:
    """Return the counts of a page."""
    sentences = [sentence for paragraph in paragraphs(text) for sentence in _END.split(paragraph)]
    words = [len(sentence.split()) for sentence in sentences]
    return Page(
        path,
        sum(words),
        [sentence for sentence in sentences if _POINTER.search(sentence)],
        [sentence for sentence in sentences if ";" in re.sub(r"`[^`]*`", "", sentence)],
        [sentence for sentence, length in zip(sentences, words, strict=True) if length > LONG_SENTENCE],
        len(sentences),
    )


def budget(path: str) -> int | None:
    """Return the words that a page may have, or None if no budget names it."""
    fitting = [part for part in BUDGETS if path.startswith(part)]
    return BUDGETS[max(fitting, key=len)] if fitting else None


def faults(page: Page) -> list[str]:
    """Return what is over a limit, each with its sentences."""
    found = []
    limit = budget(page.path)
    if limit is not None and page.words > limit:
        found.append(f"{page.words} words of text, expected at most {limit}")
    limits = (
        ("that of, those of", page.pointers, POINTERS_PER_1000 * page.words / 1000),
        ("semicolons", page.semicolons, SEMICOLONS_PER_1000 * page.words / 1000),
        (f"sentences of over {LONG_SENTENCE} words", page.long, LONG_SHARE * page.sentences),
    )
    for name, sentences, most in limits:
        if len(sentences) > max(most, 1):
            listed = "".join(f"\n    {sentence}" for sentence in sentences)
            found.append(f"{len(sentences)} {name}, expected at most {max(int(most), 1)}:{listed}")
    return found


def pages() -> list[Path]:
    """Return every page with a budget."""
    return [path for path in (*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md"))) if is_counted(path)]


def total() -> int:
    """Return the words of all documents written by hand, everything counted."""
    return sum(len(path.read_text(encoding="utf-8").split()) for path in {*pages(), *ROOT.glob("*.md")})


def is_counted(path: Path) -> bool:
    """Return whether a page is written by hand and has a budget."""
    name = path.relative_to(ROOT).as_posix()
    return budget(name) is not None and not name.startswith(("docs/reference/python/", "docs/reference/cpp/"))


def main() -> None:
    """Count, or check."""
    parser = argparse.ArgumentParser(prog="python -m tools.pages", description=__doc__)
    parser.add_argument("--check", action="store_true", help="name the sentences over a limit, and fail")
    parser.add_argument("page", nargs="*", type=Path, help="pages; default: all")
    arguments = parser.parse_args()
    wrong = 0
    for path in [page.resolve() for page in arguments.page] or pages():
        page = count(path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"))
        found = faults(page)
        wrong += len(found)
        if arguments.check:
            for fault in found:
                print(f"{page.path}: {fault}")
        else:
            shares = f"{len(page.pointers):3} pointers {len(page.semicolons):3} semicolons {len(page.long):3} long"
            print(f"{page.words:6} words {shares} of {page.sentences:4} sentences  {page.path}")
    if not arguments.page:
        everything = total()
        if everything > TOTAL or not arguments.check:
            print(f"{everything} words in all documents, expected at most {TOTAL}")
        wrong += everything > TOTAL
    sys.exit(1 if arguments.check and wrong else 0)


if __name__ == "__main__":
    main()
