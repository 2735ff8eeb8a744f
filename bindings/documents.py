"""Converts core.pyi to the docstrings and signatures that the module has at run time.

usage: documents.py core.pyi documents.inc

Classes, properties, methods and functions have their own docstrings. The docstring of a field declared in a class comes
from the section "Parameters" of the class. documents.cpp adds the lists of fields of configurations.

What a comment of a public header says too stands only there. "{planning.hpp: Each place has}" in core.pyi stands for
the part of a comment in planning.hpp that begins with these words, up to the end of its sentence, without the full
stop. "{file: first words ... last words}" goes up to the last words. The case of the first letter is that in core.pyi.
"""

from __future__ import annotations

import ast
import re
import sys
import textwrap
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MARK = re.compile(r"\{(\w+\.hpp):\s([^{}]+)\}")
PARAGRAPH = re.compile(r'^( *)(- .*(?:\n\1  \S.*)*|\S.*(?:\n\1(?!- |""")\S.*)*)$', re.MULTILINE)
CODE = re.compile(r'`([^`]+)`|("[^" ]+"|\b[a-z]+(?:_[a-z]+)+\b)(?!\()')  # text that has double backquotes in docstrings
PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?:\n\n\w+\n-+\n|\Z)", re.MULTILINE | re.DOTALL)


@cache
def comments(header: str) -> list[str]:
    """Return the comments of a public header, each on one line. Successive lines of text are one comment."""
    (path,) = ROOT.glob(f"*/include/flockstep/{header}")
    blocks: list[list[str]] = []
    continues = False
    for line in path.read_text(encoding="utf-8").splitlines():
        code, found, text = line.partition("//")
        if found and not (continues and not code.strip()):
            blocks.append([])
        if found:
            blocks[-1].append(text.strip())
        continues = bool(found) and not code.strip()
    return [" ".join(block) for block in blocks]


def comment(mark: re.Match[str]) -> str:
    """Return the part of a header's comment that a mark stands for."""
    header, words = mark[1], " ".join(mark[2].split())
    first, between, last = words.partition(" ... ")
    end = f".*?{re.escape(last)}" if between else r".*?(?=\.(?: |$)|$)"
    start = re.compile(f"(?i:{re.escape(first[0])}){re.escape(first[1:])}{end}")
    found = [text for block in comments(header) for text in start.findall(block)]
    if len(found) != 1:
        raise ValueError(f"core.pyi: expected one comment of {header} that says {words!r}, got {len(found)}")
    return CODE.sub(r"``\1\2``", first[0] + found[0][1:])


def with_comments(text: str) -> str:
    """Return a stub with the comments that its marks stand for."""

    def filled(paragraph: re.Match[str]) -> str:
        indent, body = paragraph.groups()
        if not MARK.search(body):
            return paragraph[0]
        deeper = indent + "  " * body.startswith("- ")
        body = MARK.sub(comment, " ".join(body.split()))
        return textwrap.fill(body, 120, initial_indent=indent, subsequent_indent=deeper, break_on_hyphens=False)

    return PARAGRAPH.sub(filled, text)


def entries(docstring: str) -> dict[str, str]:
    """Return the description of each name in the section "Parameters"."""
    section = PARAMETERS.search(docstring)
    if section is None:
        return {}
    found: dict[str, list[str]] = {}
    names: list[str] = []
    for line in section[1].splitlines():
        if line.startswith("    "):
            for name in names:
                found[name].append(line[4:])
        elif line:
            names = [name.strip(" *") for name in line.split(",")]
            found.update({name: [] for name in names})
    return {name: "\n".join(lines).strip() for name, lines in found.items()}


def signature(function: ast.FunctionDef) -> str:
    """Return the arguments without types, in the form that CPython reads from the first line of a docstring."""
    arguments = function.args
    if arguments.kwarg is not None and isinstance(arguments.kwarg.annotation, ast.Subscript):  # Changes[Light]
        arguments.kwarg.arg = re.sub(r"\W+", "_", ast.unparse(arguments.kwarg.annotation)).strip("_")
    for argument in [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg]:
        if argument is not None:
            argument.annotation = None
    return f"({ast.unparse(arguments)})"


def is_decorated(node: ast.FunctionDef, name: str) -> bool:
    """Return whether a function has the decorator @name or @x.name."""
    return any(ast.unparse(decorator).split(".")[-1] == name for decorator in node.decorator_list)


def documents(tree: ast.Module) -> list[tuple[str, str, str]]:
    """Return (path, signature, text) for everything that the stub documents."""
    found = [("", "", ast.get_docstring(tree) or "")]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            found.append((node.name, signature(node), ast.get_docstring(node) or ""))
        if not isinstance(node, ast.ClassDef):
            continue
        about = ast.get_docstring(node) or ""
        said = entries(about)
        members = []
        for member in node.body:
            if isinstance(member, ast.AnnAssign) and isinstance(member.target, ast.Name):
                name = member.target.id
                if not name.startswith("_"):
                    members.append((f"{node.name}.{name}", "", said.get(name, "")))
            elif isinstance(member, ast.FunctionDef) and member.name == "__init__":
                members.append((f"{node.name}.__init__", signature(member), "The class documents the arguments."))
            elif isinstance(member, ast.FunctionDef) and not is_decorated(member, "setter"):
                own = "" if is_decorated(member, "property") else signature(member)
                members.append((f"{node.name}.{member.name}", own, ast.get_docstring(member) or ""))
        found += [(node.name, "", about), *members]
    return [entry for entry in found if entry[2]]


def main(stub: Path, out: Path) -> None:
    """Write the table of documents as a C++ include file."""
    rows = documents(ast.parse(with_comments(stub.read_text(encoding="utf-8"))))
    literal = 'R"doc({})doc"'
    out.write_text(
        "".join(f"{{{', '.join(literal.format(text) for text in row)}}},\n" for row in rows), encoding="utf-8"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
