"""Generates the parts of the stub and the documents that come from lists in the engine; --check only compares.

The parts are between marks: "# fields of A, B" and "# end of fields" in envs/flockstep/_core.pyi (attributes and
__init__) and envs/flockstep/vector_env.py (the keywords of `DroneVectorEnv`; "tasks" stands for the configurations of
all tasks); "# arrays of A" and "# end of arrays" in
_core.pyi; in docs/, "<!-- arrays of A, B -->" and "<!-- end of arrays -->", "<!-- fields of A -->" and "<!-- end of
fields -->". The section "Parameters" at the end of the docstring above "# fields of A" in _core.pyi is also generated,
and so is the whole docstring of a task's configuration.
Run it with the module built after a change of such a list, then build again, because the module's docstrings come from
the stub.
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path
from typing import Any

from flockstep import _core

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "envs" / "flockstep"
DOCUMENTS = sorted((ROOT / "docs").rglob("*.md"))
MARKED = re.compile(r"^( *)# fields of ([\w, ]+)\n.*?^ *# end of fields\n", re.MULTILINE | re.DOTALL)
MARKED_ARRAYS = re.compile(r"^( *)# arrays of (\w+)\n.*?^ *# end of arrays\n", re.MULTILINE | re.DOTALL)
MARKED_TABLE = re.compile(r"^<!-- arrays of ([\w, ]+) -->\n.*?^<!-- end of arrays -->\n", re.MULTILINE | re.DOTALL)
MARKED_FIELDS = re.compile(r"^<!-- fields of (\w+) -->\n.*?^<!-- end of fields -->\n", re.MULTILINE | re.DOTALL)
ARRAY_TYPES = {
    "bool": "_Bool",
    "uint8": "_U8",
    "uint16": "_U16",
    "int32": "_I32",
    "int64": "_I64",
    "float32": "_F32",
    "float64": "_F64",
}
Field = dict[str, str]
OWN_KEYWORDS = ("autoreset_mode", "max_episode_steps", "observation")  # of DroneVectorEnv, which defines them itself


def default_text(value: Any) -> str:
    """Return a default in the format of a stub."""
    if isinstance(value, (list, tuple)):
        # CPython drops a comma before a bracket in a docstring's signature, so a tuple of one becomes a list.
        return repr(list(value) if len(value) == 1 else tuple(value)).replace("'", '"')
    if isinstance(value, float):
        return repr(float(f"{value:.6g}"))
    return (
        f'"{value}"' if isinstance(value, str) else repr(value) if value.__class__.__module__ == "builtins" else "..."
    )


def folded(line: str) -> list[str]:
    """Return a line as ruff formats it: a list that is too long gets one line per item."""
    found = re.match(r"^( *)(.*Literal\[)(.*)(\].*)$", line)
    if len(line) <= 120 or not found:
        return [line]
    indent, head, items, tail = found.groups()
    return [indent + head, *(f"{indent}    {item}," for item in items.split(", ")), indent + tail]


def types_of(config: type[Any]) -> dict[str, str]:
    """Return the types of a configuration's fields."""
    fields = config._fields if hasattr(config, "_fields") else config._attributes
    return {field["name"]: field["type"] for field in fields}


def values_text(field: Field) -> str:
    """Return the allowed values of a field with their unit: "(0, 360] deg"."""
    return f"{re.sub('^in |(?<=, )in ', '', field['values'])} {field['unit']}".strip()


def short_default(field: Field) -> str:
    """Return the repr of a default; for a configuration only its class."""
    return re.sub(r"^(\w+)\(.*\)$", r"\1()", field["default"])


def parameters(indent: str, config: type[Any]) -> list[str]:
    """Return the section "Parameters" of a docstring, and its end."""
    lines = [f"{indent}Parameters", f"{indent}----------"]
    for field in config._fields:
        values = values_text(field)
        facts = f"{'Values' if field['values'] else 'Unit'}: {values}. " if values else ""
        text = f"{field['about']} {facts}Default: {short_default(field)}."
        inner = f"{indent}    "
        lines.append(f"{indent}{field['name']}")
        lines += textwrap.wrap(text, 120, initial_indent=inner, subsequent_indent=inner, break_on_hyphens=False)
    return [*lines, f'{indent}"""', ""]


def words(indent: str, config: type[Any]) -> list[str]:
    """Return the docstring of a task's configuration as far as the section "Parameters"."""
    said = config._words  # type: ignore[attr-defined]
    lines = [f'{indent}"""{config._about}', ""]  # type: ignore[attr-defined]

    def add(text: str, item: str = "") -> None:
        inner = indent + " " * len(item)
        lines.extend(
            textwrap.wrap(text, 120, initial_indent=indent + item, subsequent_indent=inner, break_on_hyphens=False)
        )

    for text in (said["about"], f"**Start**: {said['start']}", f"**Action**: {said['action']}"):
        add(text)
        lines.append("")
    for title, text, parts in (
        ("Observation", said["observed"], said["observation"]),
        ("Reward", "The sum of these terms:", said["reward"]),
    ):
        add(f"**{title}**: {text}")
        lines.append("")
        for name, about in parts:
            add(f"{name}: {about}", "- ")
        lines.append("")
    add(f"**End**: {said['end']}")
    return [*lines, ""]


def field_table(fields: list[Field]) -> list[str]:
    """Return a table of the fields of a configuration."""
    lines = ["| field | type | values | default | description |", "|---|---|---|---|---|"]
    for field in fields:
        kind = re.sub(r"Literal\[(.*)\]", r"\1", field["type"]).replace(" | None", " or None")
        cells = [
            f"`{field['name']}`",
            kind.replace("Sequence", "sequence").replace("[", " of ").replace("]", ""),
            values_text(field),
            f"`{short_default(field)}`",
            field["about"].replace("``", "`"),
        ]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return lines


def class_body(indent: str, config: type[Any]) -> list[str]:
    """Return the attributes and the __init__ of a configuration."""
    types = types_of(config)
    attributes = [f"{indent}{name}: {text}" for name, text in types.items()]
    if not hasattr(config, "__match_args__"):  # no keyword constructor
        return [part for line in attributes for part in folded(line)]
    defaults = config()
    lines = [f"{indent}__match_args__: ClassVar[tuple[str, ...]]", *attributes]
    lines += [f"{indent}def __init__(", f"{indent}    self,", f"{indent}    *,"]
    for name, text in types.items():
        lines.append(f"{indent}    {name}: {text} = {default_text(getattr(defaults, name))},")
    return [part for line in [*lines, f"{indent}) -> None: ..."] for part in folded(line)]


def keywords(indent: str, configs: list[type[Any]]) -> list[str]:
    """Return the fields of several configurations, for a TypedDict."""
    types = {name: text for config in configs for name, text in types_of(config).items()}
    lines = [f"{indent}{name}: {text}" for name, text in types.items() if name not in OWN_KEYWORDS]
    return [part for line in lines for part in folded(line)]


def array_text(array: dict[str, Any]) -> str:
    """Return the docstring of a view of an array."""
    unit = f" {array['unit']}" if array["unit"] else ""
    frame = f", {array['frame']} frame" if array["frame"] else ""
    about = array["about"] + (". You may overwrite it; the batch never reads it" if array["writable"] else "")
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
        owners = {"Contact": "contact.", "Lidar": "lidar().", "Camera": "camera().", "Bodies": "bodies."}
        owner = owners.get(cls.__name__, "")
        for array in cls._arrays:
            cells = (array[key] for key in ("dtype", "shape", "unit", "frame", "writer", "about"))
            lines.append(f"| `{owner}{array['name']}` | " + " | ".join(cells) + " |")
    return lines


def configs_named(name: str) -> list[type[Any]]:
    """Return the configuration of a name; for "tasks" those of all tasks."""
    return list(_core.engine_tasks.values()) if name == "tasks" else [getattr(_core, name)]


def with_fields(path: Path) -> str:
    """Return a Python file's text with the fields of configurations and their docstrings regenerated."""
    text = path.read_text(encoding="utf-8")
    new, end = "", 0
    for match in MARKED.finditer(text):
        indent, names = match.group(1), match.group(2)
        configs = [config for name in names.split(",") for config in configs_named(name.strip())]
        before = text[end : match.start()]
        head, section, rest = before.rpartition(f"{indent}Parameters\n")
        if section and rest.endswith('"""\n\n') and rest.count('"""') == 1:
            if hasattr(configs[0], "_words"):
                head = head[: head.rindex('"""') - len(indent)] + "\n".join(words(indent, configs[0])) + "\n"
            before = head + "\n".join(parameters(indent, configs[0])) + "\n"
        lines = class_body(indent, configs[0]) if path.suffix == ".pyi" else keywords(indent, configs)
        new += before + "\n".join([f"{indent}# fields of {names}", *lines, f"{indent}# end of fields"]) + "\n"
        end = match.end()
    return new + text[end:]


def renewed(path: Path) -> str:
    """Return a file's text with its marked parts regenerated."""

    def replace_arrays(match: re.Match[str]) -> str:
        indent, name = match.group(1), match.group(2)
        lines = array_properties(indent, getattr(_core, name))
        return "\n".join([f"{indent}# arrays of {name}", *lines, f"{indent}# end of arrays"]) + "\n"

    def replace_table(match: re.Match[str]) -> str:
        lines = array_table([getattr(_core, name.strip()) for name in match.group(1).split(",")])
        return "\n".join([f"<!-- arrays of {match.group(1)} -->", *lines, "<!-- end of arrays -->"]) + "\n"

    def replace_fields(match: re.Match[str]) -> str:
        name = match.group(1)
        fields = _core._other_fields.get(name) or getattr(_core, name)._fields
        return "\n".join([f"<!-- fields of {name} -->", *field_table(fields), "<!-- end of fields -->"]) + "\n"

    text = MARKED_FIELDS.sub(replace_fields, with_fields(path))
    return MARKED_TABLE.sub(replace_table, MARKED_ARRAYS.sub(replace_arrays, text))


if __name__ == "__main__":
    from renew import renew  # beside this file

    renew({path: renewed(path) for path in (PACKAGE / "_core.pyi", PACKAGE / "vector_env.py", *DOCUMENTS)})
