"""Doxygen's input filter: prints a public header with its comments in the form that Doxygen reads.

usage: doxygen_filter.py HEADER

The headers have ordinary ``//`` comments. A comment above a declaration or behind it becomes its documentation, also
for the overloads that follow without a comment. Four texts come from elsewhere in the header: its first comment
("Batch: ...") describes the class of that name, an entry of ``fields()`` describes its member, ``// --- title; text``
begins a group of members, and `USUAL` has the members that many structs have. Lines keep their numbers, except by the
groups.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

HEADERS = Path(__file__).resolve().parents[2] / "engine" / "include" / "flockstep"
SHARED = HEADERS / "sensors" / "sensor_fields.hpp"  # constants that fields() of several headers use

NOT_CODE = re.compile(r'//[^\n]*|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])\'|^#(?:[^\n]*\\\n)*[^\n]*', re.MULTILINE)
SCOPE = re.compile(r"\b(namespace|class|struct|union|enum)\b(?:\s+(?:class|FLOCKSTEP_API))?\s+(\w*)")
ACCESS = re.compile(r"(?:public|private|protected):")
FUNCTION = re.compile(r"(operator\S+|~?\w+)\s*\(")
MEMBER = re.compile(r"(\w+)\s*(?:=.*|\{.*)?$", re.DOTALL)
ENTRY = re.compile(r'\b(field|array)\(\s*"\w+",\s*&C::(\w+)')
CONSTANT = re.compile(r"constexpr FieldInfo (k\w+)(?=\{)")
TWO = re.compile(r"([\w:<>]+) \w+(?: = \w+)?(,) \w+(?: = \w+)?;")
LITERAL = re.compile(r'\s*"((?:\\.|[^"\\])*)"')

ROWS = {"drone": "N", "env": "E", "task": "R", "body": "E, B"}
ITEMS = {"row": "", "term": "terms", "ray": "channels, beams", "pixel": "height, width", "rotor": "rotors"}
USUAL = (
    (re.compile(r"\bauto fields\(\)"), "The list of the members, from which checks, hashes and documents are made."),
    (re.compile(r"\bvoid validate\(\) const"), "Throws `std::invalid_argument` naming the field with a bad value."),
    (re.compile(r"\boperator==\(.*= default"), "Compares all members."),
    (re.compile(r"^template <>"), "The value for this type."),
    (re.compile(r"\bkName = "), "Name of the task in recipes."),
    (re.compile(r"\bkAbout = "), "What it is, for its docstring."),
    (re.compile(r"\bTaskWords words\(\)"), "Words about the task, from which its page and `help()` are made."),
    (re.compile(r"\bmake_task\("), "Makes the task. Throws `std::invalid_argument` on a bad config."),
    (re.compile(r"\bkSizes\{"), "Limits of `size_m`, for each axis."),
)


@dataclass
class Declaration:
    """A declaration: its range, the end of its head, and the class that it is in."""

    start: int
    head_end: int  # at the opening brace of a body, or at the end
    end: int
    owner: str
    texts: list[str] = field(default_factory=list)


class Header:
    """A header, its code without comments and literals at the same positions, and its comments."""

    def __init__(self, text: str, shared: str) -> None:
        self.text = text
        self.comments = {match.start(): match[0] for match in NOT_CODE.finditer(text) if match[0].startswith("//")}
        self.code = NOT_CODE.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
        self.constants = {
            match[1]: source[match.end() : closed(source, match.end())]
            for source in (shared, text)
            for match in CONSTANT.finditer(source)
        }

    def line_start(self, position: int) -> int:
        """Return where the line of a position begins."""
        return self.text.rfind("\n", 0, position) + 1

    def is_full_line(self, position: int) -> bool:
        """Return whether only spaces stand before a position on its line."""
        return not self.text[self.line_start(position) : position].strip()

    def declarations(self, begin: int, end: int, owner: str = "") -> Iterator[Declaration]:
        """Yield the declarations in a range, and those in the classes, enumerations and namespaces there."""
        code, at = self.code, begin
        while (found := re.compile(r"[^\s;]").search(code, at, end)) is not None:
            start = found.start()
            if access := ACCESS.match(code, start):
                at = access.end()
                if access[0] != "public:":
                    return
                continue
            head_end = stop_of(code, start, end, "{;")
            scope = SCOPE.search(re.sub(r"template <[^{;]*>\s", "", code[start:head_end]))
            if head_end >= end or code[head_end] == ";":
                at = min(head_end + 1, end)
                yield Declaration(start, head_end, at, owner)
                continue
            at = closed(code, head_end)
            if scope is None or re.search(r"[(=]", code[start:head_end]):  # a body, or a value in braces
                if re.match(r"\s*;", code[at:]):
                    at = code.index(";", at) + 1
                yield Declaration(start, head_end, at, owner)
            elif scope[1] == "namespace":
                yield from self.declarations(head_end + 1, at - 1)
            else:
                yield Declaration(start, head_end, head_end + 1, owner)
                if scope[1] == "enum":
                    yield from self.enumerators(head_end + 1, at - 1)
                elif scope[2] != "EnumNames":
                    yield from self.declarations(head_end + 1, at - 1, scope[2])

    def enumerators(self, begin: int, end: int) -> Iterator[Declaration]:
        """Yield the members of an enumeration."""
        for match in re.finditer(r"[^\s,][^,]*", self.code[begin:end]):
            last = begin + match.end()
            yield Declaration(begin + match.start(), last, min(last + 1, end), "")

    def comment_behind(self, declaration: Declaration) -> list[int]:
        """Return the positions of the comments at the ends of a declaration's lines, with the lines that go on."""
        line_end = self.text.find("\n", declaration.head_end)
        last_end = self.text.find("\n", declaration.end - 1)
        found: list[int] = []
        for at in sorted(self.comments):
            behind = declaration.start < at < line_end or declaration.end <= at < last_end
            if behind and (not self.is_full_line(at) or found):
                found.append(at)
        while found:  # lines below, at the same column
            column = found[-1] - self.line_start(found[-1])
            below = self.text.find("\n", found[-1]) + 1 + column
            if below not in self.comments or not self.is_full_line(below):
                break
            found.append(below)
        return [at for at in found if not self.comments[at].startswith("// NOLINT")]

    def comment_above(self, declaration: Declaration) -> list[int]:
        """Return the positions of the comments on the lines right above a declaration."""
        found: list[int] = []
        indent = declaration.start - self.line_start(declaration.start)
        at = self.line_start(self.line_start(declaration.start) - 1) + indent
        while at in self.comments and self.is_full_line(at) and not self.comments[at].startswith("// --"):
            found.insert(0, at)
            at = self.line_start(self.line_start(at) - 1) + indent
        return found

    def listed(self) -> dict[str, str]:
        """Return the descriptions in the lists of fields, by "Struct::member"."""
        found = {}
        for struct in re.finditer(r"using C = (\w+);", self.text):
            body = self.text[struct.end() : self.text.find("\n  }", struct.end())]
            for match in ENTRY.finditer(body):
                info = body[match.end() : closed(body, match.start() + len(match[1])) - 1].lstrip(", \n")
                found[f"{struct[1]}::{match[2]}"] = self.entry_text(match[1], info)
        return found

    def entry_text(self, kind: str, info: str) -> str:
        """Return the description in the third argument of ``field()`` or ``array()``."""
        info = self.constants.get(info, info)
        call = re.match(r"\w+\(", info)
        about = literals(info[call.end() :] if call else info.partition(".about =")[2])
        if not about:
            return ""
        unit = re.search(r'\.unit = "([^"]+)"', info)
        if kind == "field":
            limits = re.search(r"\.limits = (\w+\([^)]*\))", info)
            text = about + (f" Unit: {unit[1]}." if unit else "") + (f" Limits: `{limits[1]}`." if limits else "")
            return text.replace("``", "`")
        rows, per, columns, frame = (
            found[1] if (found := re.search(pattern, info)) else ""
            for pattern in (r"Rows::(\w+)", r"Per::(\w+)", r"\.columns = (\d+)", r"Frame::(\w+)")
        )
        shape = [ROWS[rows or ("task" if call else "drone")], ITEMS[per or "row"], columns]
        dimensions = ", ".join(part for part in shape if part)
        head = f"({dimensions}{'' if ',' in dimensions else ','})" + (f" {unit[1]}" if unit else "")
        return f"{head}{f', {frame} frame' if frame else ''}: {about}."

    def of_classes(self) -> dict[str, str]:
        """Return the descriptions in the first comment, by class."""
        lines = self.text[: self.text.index("#pragma once")].splitlines()
        text = " ".join(line[2:].strip() for line in lines if line[2:5] != "   ")
        names, colon, about = text.partition(": ")
        return dict.fromkeys(names.split(" and "), about[:1].upper() + about[1:]) if colon else {}

    def groups(self) -> Iterator[tuple[int, int, str]]:
        """Yield edits that turn ``// --- title; text`` and the members up to the next one into a group."""
        is_open = False
        for match in re.finditer(r"^ +// --- ([^;\n]*)(?:; )?([^\n]*)|^ private:|^};", self.text, re.MULTILINE):
            close = "/** @} */ " if is_open else ""
            is_open = match[1] is not None
            if is_open:
                title = match[1][:1].upper() + match[1][1:]
                yield match.start(), len(match[0]), f"{close}/** @name {title}\n{match[2]} */ /** @{{ */"
            elif close:
                yield match.start(), 0, close

    def documented(self) -> str:
        """Return the header in Doxygen's form."""
        # Position: the number of characters removed there, and the text inserted.
        edits = {at: (removed, new) for at, removed, new in self.groups()}
        listed, of_classes = self.listed(), self.of_classes()
        last: tuple[str, list[str]] = ("", [])
        for it in self.declarations(0, len(self.text)):
            head = self.code[it.start : it.head_end]
            above, behind = self.comment_above(it), self.comment_behind(it)
            texts = [" ".join(self.comments[at][2:].strip() for at in behind)]
            plain = re.sub(r"template <[^{;]*?>\s+(?=\w)", "", head)
            function = FUNCTION.search(plain)
            scope = None if function else SCOPE.match(plain)
            if scope and not above:
                texts.append(of_classes.get(scope[2], ""))
            member = None if function or scope else MEMBER.search(plain)
            if member:
                texts.insert(0, listed.get(f"{it.owner}::{member[1]}", ""))
            name = function[1] if function else ""
            all_texts = [" ".join(self.comments[at][2:].strip() for at in above), *texts]
            gap = self.text[self.line_start(it.start) - 2 : self.line_start(it.start)] == "\n\n"
            if not any(all_texts):
                if name and name == last[0] and not gap:
                    all_texts = texts = last[1]
                else:
                    all_texts = texts = [
                        usual for pattern, usual in USUAL if pattern.search(self.text[it.start : it.end])
                    ]
            last = (name, all_texts)
            for at in above:
                edits[at] = (2, "///")
            for at in behind:
                edits[at] = (len(self.comments[at]), "")
            if any(texts):
                edits[it.start] = (0, f"/** {sentences(texts)} */ ")
            if any(all_texts) and (two := TWO.match(self.code, it.start)):  # Doxygen documents only the first of them
                edits[two.start(2)] = (1, f"; /** {sentences(all_texts)} */ {two[1]}")
        for at in self.comments:  # above a macro
            rest = re.match(r"(?:\n//[^\n]*)*\n#define", self.text[self.text.find("\n", at) :])
            if rest and self.text[at - 1] == "\n":
                edits[at] = (2, "///")
        for name in self.constants:  # Sphinx cannot read designated initialisers
            if place := re.search(rf"constexpr FieldInfo {name}(?=\{{)", self.text):
                end = closed(self.text, place.end())
                edits[place.end()] = (end - place.end(), "\n" * self.text.count("\n", place.end(), end))
        edits[self.text.index("#pragma once")] = (0, "/** @file */ ")
        text, done = "", 0
        for at, (removed, new) in sorted(edits.items()):
            text += self.text[done:at] + new
            done = at + removed
        return text + self.text[done:]


def sentences(texts: list[str]) -> str:
    """Return the texts that are not empty as one, with a full stop after each."""
    return " ".join(text if text.endswith((".", ":")) else f"{text}." for text in texts if text)


def closed(text: str, start: int) -> int:
    """Return the position after the bracket that closes the one at ``start``."""
    depth, at = 0, start
    while at < len(text):
        if literal := LITERAL.match(text, at):
            at = literal.end()
            continue
        depth += (text[at] in "({[") - (text[at] in ")}]")
        at += 1
        if depth == 0:
            break
    return at


def stop_of(code: str, start: int, end: int, stops: str) -> int:
    """Return the position of the first of some letters outside of parentheses."""
    depth = 0
    for at in range(start, end):
        depth += (code[at] == "(") - (code[at] == ")")
        if depth == 0 and code[at] in stops:
            return at
    return end


def literals(text: str) -> str:
    """Return the value of the string literals that a text begins with."""
    parts, at = [], 0
    while match := LITERAL.match(text, at):
        parts.append(match[1])
        at = match.end()
    return "".join(parts).replace('\\"', '"')


if __name__ == "__main__":
    path = Path(sys.argv[1])
    shared = SHARED.read_text(encoding="utf-8")
    # How the batch makes a sensor is internal; the lines stay, for their numbers.
    internal = re.compile(r"^namespace sensors \{$.*?^\}  // namespace sensors$", re.DOTALL | re.MULTILINE)
    text = internal.sub(lambda match: "\n" * match[0].count("\n"), path.read_text(encoding="utf-8"))
    sys.stdout.write(Header(text, shared).documented())
