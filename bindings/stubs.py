"""Writes what stubs say of the fields of configurations, from the fields themselves; --check only compares.

Between the lines "# fields of A, B" and "# end of fields" of envs/flockstep/_core.pyi (attributes and __init__) and of
envs/flockstep/vector_env.py (the keywords of `DroneVectorEnv`). Run it after a change of fields(), with the module
built.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from flockstep import _core

PACKAGE = Path(__file__).resolve().parents[1] / "envs" / "flockstep"
MARKED = re.compile(r"^( *)# fields of ([\w, ]+)\n.*?^ *# end of fields\n", re.MULTILINE | re.DOTALL)
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


def renewed(path: Path) -> str:
    """Return a file's text with its marked parts made anew."""

    def replace(match: re.Match[str]) -> str:
        indent, names = match.group(1), match.group(2)
        configs = [getattr(_core, name.strip()) for name in names.split(",")]
        lines = class_body(indent, configs[0]) if path.suffix == ".pyi" else keywords(indent, configs)
        return "\n".join([f"{indent}# fields of {names}", *lines, f"{indent}# end of fields"]) + "\n"

    return MARKED.sub(replace, path.read_text())


def main() -> None:
    """Write or check."""
    stale = False
    for path in (PACKAGE / "_core.pyi", PACKAGE / "vector_env.py"):
        text = renewed(path)
        if text == path.read_text():
            continue
        stale = True
        if "--check" in sys.argv:
            print(f"{path.name}: its fields are not those of the module; run bindings/stubs.py")
        else:
            path.write_text(text)
    if stale and "--check" in sys.argv:
        sys.exit(1)


if __name__ == "__main__":
    main()
