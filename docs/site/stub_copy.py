"""The stub in the form that the Python reference is made from."""

from __future__ import annotations

import ast
import re

from documents import entries  # bindings/documents.py


def copied(text: str) -> str:
    """Return the stub with a docstring at each field and enumerator, and without its aliases of array types."""
    return without_aliases(with_documented_fields(with_documented_members(text)))


def with_documented_fields(text: str) -> str:
    """Move the texts of the sections "Parameters" to the fields that they describe."""
    lines = text.splitlines()
    after: dict[int, str] = {}  # the docstring of the field that ends in this line
    dropped: set[int] = set()
    for cls in [node for node in ast.parse(text).body if isinstance(node, ast.ClassDef)]:
        said = entries(ast.get_docstring(cls) or "")
        fields = {ast.unparse(node.target): node for node in cls.body if isinstance(node, ast.AnnAssign)}
        own = {name: node for name, node in fields.items() if name in said}
        after.update({node.end_lineno or 0: f'    """{said[name]}"""' for name, node in own.items()})
        inside = False
        for number in range(cls.body[0].lineno, (cls.body[0].end_lineno or 0) if own else 0):
            line = lines[number - 1]
            if line == "    Parameters" and set(own) == set(said):
                dropped |= {number, number + 1}
            if re.match(r"    \S", line):
                inside = line.strip() in own
            if inside:
                dropped.add(number)
    kept = []
    for number, line in enumerate(lines, 1):
        kept += [line] if number not in dropped else []
        kept += [after[number]] if number in after else []
    return "\n".join(kept) + "\n"


def with_documented_members(text: str) -> str:
    """Move the items of a list in a class's docstring to the enumerators that they describe."""
    for match in list(re.finditer(r"^    - ``(\w+)``: (.*(?:\n      .*)*)\n", text, re.MULTILINE)):
        documented = rf'\g<0>    """{match[2]}"""' + "\n"
        text, count = re.subn(rf"^    {match[1]} = \d+\n", documented, text, count=1, flags=re.MULTILINE)
        text = text.replace(match[0], "", count)
    return text


def without_aliases(text: str) -> str:
    """Replace the aliases of types by what they stand for."""
    for name, value in re.findall(r"^(_\w+): TypeAlias = ([^#\n]+?) *(?:#.*)?$", text, re.MULTILINE):
        text = re.sub(rf"(?<![\w.]){name}(?!\w|: TypeAlias)", value, text)
    return text
