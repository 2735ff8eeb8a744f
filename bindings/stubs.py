"""Writes the parts of the stub and of the documents that are made from lists in the engine; --check only compares.

The parts stand between marks: "# fields of A, B" and "# end of fields" in envs/flockstep/_core.pyi (attributes and
__init__) and envs/flockstep/vector_env.py (the keywords of `DroneVectorEnv`); "# arrays of A" and "# end of arrays" in
_core.pyi; "<!-- arrays of A, B -->" and "<!-- end of arrays -->" in docs/conventions.md. Run it after a change of such
a list, with the module built.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from flockstep import _core

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "envs" / "flockstep"
MARKED = re.compile(r"^( *)# fields of ([\w, ]+)\n.*?^ *# end of fields\n", re.MULTILINE | re.DOTALL)
MARKED_ARRAYS = re.compile(r"^( *)# arrays of (\w+)\n.*?^ *# end of arrays\n", re.MULTILINE | re.DOTALL)
MARKED_TABLE = re.compile(r"^<!-- arrays of ([\w, ]+) -->\n.*?^<!-- end of arrays -->\n", re.MULTILINE | re.DOTALL)
ARRAY_TYPES = {
    "bool": "_Bool",
    "uint8": "_U8",
    "uint16": "_U16",
    "int32": "_I32",
    "int64": "_I64",
    "float32": "_F32",
    "float64": "_F64",
}
OWN_KEYWORDS = ("autoreset_mode", "max_episode_steps", "observation")  # of DroneVectorEnv, spelled out there


def default_text(value: Any) -> str:
    """Return a default as a stub has it."""
    if isinstance(value, (list, tuple)):
        # CPython drops a comma before a bracket where it reads a signature from a docstring: no tuple of one.
        return repr(list(value) if len(value) == 1 else tuple(value)).replace("'", '"')
    if isinstance(value, float):
        return repr(float(f"{value:.6g}"))
    return (
        f'"{value}"' if isinstance(value, str) else repr(value) if value.__class__.__module__ == "builtins" else "..."
    )


def folded(line: str) -> list[str]:
    """Return a line as ruff formats it: a list that is too long has a line for each of its items."""
    found = re.match(r"^( *)(.*Literal\[)(.*)(\].*)$", line)
    if len(line) <= 120 or not found:
        return [line]
    indent, head, items, tail = found.groups()
    return [indent + head, *(f"{indent}    {item}," for item in items.split(", ")), indent + tail]


def class_body(indent: str, config: type[Any]) -> list[str]:
    """Return the attributes and the __init__ of a configuration."""
    types: dict[str, str] = config._field_types
    defaults = config()
    lines = [f"{indent}__match_args__: ClassVar[tuple[str, ...]]"]
    lines += [f"{indent}{name}: {text}" for name, text in types.items()]
    lines += [f"{indent}def __init__(", f"{indent}    self,", f"{indent}    *,"]
    for name, text in types.items():
        lines.append(f"{indent}    {name}: {text} = {default_text(getattr(defaults, name))},")
    return [part for line in [*lines, f"{indent}) -> None: ..."] for part in folded(line)]


def keywords(indent: str, configs: list[type[Any]]) -> list[str]:
    """Return the fields of several configurations, for a TypedDict."""
    types = {name: text for config in configs for name, text in config._field_types.items()}
    lines = [f"{indent}{name}: {text}" for name, text in types.items() if name not in OWN_KEYWORDS]
    return [part for line in lines for part in folded(line)]


def array_text(array: dict[str, Any]) -> str:
    """Return the docstring of a view of an array."""
    unit = f" {array['unit']}" if array["unit"] else ""
    frame = f", {array['frame']} frame" if array["frame"] else ""
    about = array["about"] + (". Writable, and never read back" if array["writable"] else "")
    return f"{array['shape']}{unit}{frame}: {about}."


def array_properties(indent: str, cls: type[Any]) -> list[str]:
    """Return the properties of a class that view arrays."""
    lines: list[str] = []
    for array in cls._arrays:
        text = array_text(array)
        lines += [
            "",
            f"{indent}@property",
            f"{indent}def {array['name']}(self) -> {ARRAY_TYPES[array['dtype']]}:",
            f'{indent}    """{text}"""',
        ]
    return lines[1:]


def array_table(classes: list[type[Any]]) -> list[str]:
    """Return a table of the arrays of some classes."""
    lines = ["| array | type | shape | unit | frame | written by | content |", "|---|---|---|---|---|---|---|"]
    for cls in classes:
        owner = {"Contact": "contact.", "Lidar": "lidar().", "Camera": "camera()."}.get(cls.__name__, "")
        for array in cls._arrays:
            cells = (array[key] for key in ("dtype", "shape", "unit", "frame", "writer", "about"))
            lines.append(f"| `{owner}{array['name']}` | " + " | ".join(cells) + " |")
    return lines


def renewed(path: Path) -> str:
    """Return a file's text with its marked parts written again."""

    def replace(match: re.Match[str]) -> str:
        indent, names = match.group(1), match.group(2)
        configs = [getattr(_core, name.strip()) for name in names.split(",")]
        lines = class_body(indent, configs[0]) if path.suffix == ".pyi" else keywords(indent, configs)
        return "\n".join([f"{indent}# fields of {names}", *lines, f"{indent}# end of fields"]) + "\n"

    def replace_arrays(match: re.Match[str]) -> str:
        indent, name = match.group(1), match.group(2)
        lines = array_properties(indent, getattr(_core, name))
        return "\n".join([f"{indent}# arrays of {name}", *lines, f"{indent}# end of arrays"]) + "\n"

    def replace_table(match: re.Match[str]) -> str:
        lines = array_table([getattr(_core, name.strip()) for name in match.group(1).split(",")])
        return "\n".join([f"<!-- arrays of {match.group(1)} -->", *lines, "<!-- end of arrays -->"]) + "\n"

    text = MARKED.sub(replace, path.read_text())
    return MARKED_TABLE.sub(replace_table, MARKED_ARRAYS.sub(replace_arrays, text))


def main() -> None:
    """Write or check."""
    stale = False
    for path in (PACKAGE / "_core.pyi", PACKAGE / "vector_env.py", ROOT / "docs" / "conventions.md"):
        text = renewed(path)
        if text == path.read_text():
            continue
        stale = True
        if "--check" in sys.argv:
            print(f"{path.name}: it differs from the module; run bindings/stubs.py")
        else:
            path.write_text(text)
    if stale and "--check" in sys.argv:
        sys.exit(1)


if __name__ == "__main__":
    main()
