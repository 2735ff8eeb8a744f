"""Converts core.pyi to the docstrings and signatures that the module has at run time.

usage: documents.py core.pyi documents.inc

Classes, properties, methods and functions have their own docstrings. The docstring of a field declared in a class comes
from the section "Parameters" of the class. documents.cpp adds the lists of fields of configurations.
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

PARAMETERS = re.compile(r"^Parameters\n-+\n(.*?)(?:\n\n\w+\n-+\n|\Z)", re.MULTILINE | re.DOTALL)


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
    rows = documents(ast.parse(stub.read_text(encoding="utf-8")))
    literal = 'R"doc({})doc"'
    out.write_text(
        "".join(f"{{{', '.join(literal.format(text) for text in row)}}},\n" for row in rows), encoding="utf-8"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
