"""Counts habits that make prose hard to read: ``python -m tools.plain_words``. With ``--check`` it fails on the worst.

Prose is the comments and docstrings of the sources and the text of the pages, without code blocks. ``--check`` also
reads the string literals of the sources, such as messages. CHANGELOG.md and files that are generated are left out.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TypeAlias

Reader: TypeAlias = Callable[[str], Iterator[tuple[int, str]]]

ROOT = Path(__file__).resolve().parents[1]
#: Words that are counted. Most have a right use, too, so their number says something and a single one does not.
HABITS = (
    "alone",
    "told",
    "what is",
    "where it",
    "of its own",
    "whatever",
    "likewise",
    "so many",
    "as it is",
    "but for",
    "anew",
)
#: Never right in this project's prose, and how a comment or docstring never begins.
REFUSED = ("anew", "but for", "likewise", "as it is", "so many")
OPENINGS = ("Of", "What", "Whether", "Where")
#: A file and a part of the text: places where such a word is right.
ALLOWED: tuple[tuple[str, str], ...] = (
    *(("tools/plain_words.py", word) for word in REFUSED),
    *(("tests/python/tools/test_commands.py", word) for word in REFUSED),
)

_CPP = re.compile(
    r'R"(?P<mark>[^\s()\\]{0,16})\((?P<raw>(?:.|\n)*?)\)(?P=mark)"'
    r'|"(?P<string>(?:\\.|[^"\\\n])*)"'
    r"|(?<![0-9a-fA-F])'(?:\\.|[^'\\\n])*'"
    r"|(?P<comment>//[^\n]*)"
)
_CODE = re.compile(r"^ *```\w*\n.*?^ *```$|<!--.*?-->", re.MULTILINE | re.DOTALL)


def cpp_comments(text: str) -> Iterator[tuple[int, str]]:
    """Yield the line number and the text of each comment; comments on lines that follow each other are one."""
    number, begun, lines = 0, 0, list[str]()
    for match in _CPP.finditer(text):
        if match["comment"] is None:
            continue
        line = text.count("\n", 0, match.start()) + 1
        is_trailing = text[text.rfind("\n", 0, match.start()) + 1 : match.start()].strip() != ""
        if lines and (line != number + 1 or is_trailing):
            yield begun, " ".join(lines)
            lines = []
        begun = begun if lines else line
        number = line
        lines.append(match["comment"].lstrip("/ "))
    if lines:
        yield begun, " ".join(lines)


def cpp_strings(text: str) -> Iterator[tuple[int, str]]:
    """Yield the line number and the text of each string; literals that follow each other are one."""
    begun, end, parts = 0, 0, list[str]()
    for match in _CPP.finditer(text):
        literal = match["string"] if match["raw"] is None else match["raw"]
        if literal is None:
            continue
        if parts and text[end : match.start()].strip():
            yield begun, "".join(parts)
            parts = []
        begun = begun if parts else text.count("\n", 0, match.start()) + 1
        end = match.end()
        parts.append(literal)
    if parts:
        yield begun, "".join(parts)


def python_strings(text: str) -> Iterator[tuple[int, str]]:
    """Yield line number and text of each string except docstrings, with ``{}`` for the values in an f-string."""
    nodes = list(ast.walk(ast.parse(text)))
    others = {part for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    others |= {node.value for node in nodes if isinstance(node, ast.Expr)}  # docstrings
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in others:
            yield node.lineno, node.value
        elif isinstance(node, ast.JoinedStr):
            values = (part.value if isinstance(part, ast.Constant) else "{}" for part in node.values)
            yield node.lineno, "".join(map(str, values))


def python_prose(text: str) -> Iterator[tuple[int, str]]:
    """Yield the line number and the text of each comment and docstring."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string.lstrip("#: ")
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            docstring = ast.get_docstring(node)
            if docstring is not None:
                yield node.body[0].lineno, docstring


def page_prose(text: str) -> Iterator[tuple[int, str]]:
    """Yield the line number and the text of each line of a page outside of code blocks."""
    without_code = _CODE.sub(lambda match: "\n" * match[0].count("\n"), text)
    yield from enumerate(without_code.splitlines(), 1)


#: Readers of prose and of strings, by the suffix of the file.
PROSE = {".cpp": cpp_comments, ".hpp": cpp_comments, ".py": python_prose, ".pyi": python_prose, ".md": page_prose}
STRINGS = {".cpp": cpp_strings, ".hpp": cpp_strings, ".py": python_strings}


def texts(readers: Mapping[str, Reader]) -> Iterator[tuple[str, int, str]]:
    """Yield file, line number and text of everything in the checkout that the readers find."""
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    for file in files:
        reader = readers.get(Path(file).suffix)
        if reader is None or file == "CHANGELOG.md":
            continue
        for line, text in reader((ROOT / file).read_text(encoding="utf-8")):
            yield file, line, text


def faults(file: str, text: str, is_string: bool = False) -> list[str]:
    """Return the faults of a piece of prose or of a string. A string may begin with any word."""
    if any(file == allowed and part in text for allowed, part in ALLOWED):
        return []
    found = [f'"{word}"' for word in REFUSED if re.search(rf"\b{word}\b", text)]
    if not is_string and not file.endswith(".md") and text.split(" ", 1)[0] in OPENINGS:
        found.append(f'it begins with "{text.split(" ", 1)[0]}"')
    return found


def main() -> None:
    """Count, or check."""
    parser = argparse.ArgumentParser(prog="python -m tools.plain_words", description=__doc__)
    parser.add_argument("--check", action="store_true", help="name the places that are always wrong, and fail")
    arguments = parser.parse_args()
    counts: Counter[str] = Counter()
    wrong = 0
    for file, line, text in texts(PROSE):
        for word in HABITS:
            counts[word] += len(re.findall(rf"\b{word}\b", text, re.IGNORECASE))
        found = faults(file, text)
        wrong += len(found)
        if not file.endswith(".md"):
            counts["begins with Of, What, Whether, Where"] += text.split(" ", 1)[0] in OPENINGS
        if arguments.check:
            for fault in found:
                print(f"{file}:{line}: {fault}")
    if arguments.check:
        for file, line, text in texts(STRINGS):
            for fault in faults(file, text, is_string=True):
                print(f"{file}:{line}: {fault} in a string")
                wrong += 1
        sys.exit(1 if wrong else 0)
    for word, count in counts.most_common():
        print(f"{count:5} {word}")


if __name__ == "__main__":
    main()
