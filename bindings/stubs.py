"""Generates the parts of the stub and the documents that come from lists in the engine; --check only compares.

The parts are between marks: in envs/flockstep/_core.pyi "# fields of A" and "# end of fields" (attributes and
__init__), "# keywords of Batch" and "# end of keywords", "# tasks" and "# end of tasks", "# arrays of A" and "# end of
arrays"; in docs/, "<!-- arrays of A, B -->" and "<!-- end of arrays -->", "<!-- fields of A -->" and "<!-- end of
fields -->". Generated without marks: the section "Parameters" at the end of the docstring above "# fields of A", the
whole docstring of a task's configuration, the entries of Batch's that are fields, and envs/flockstep/env_keywords.py.
Run it with the module built after a change of such a list, then build again, because the module's docstrings come from
the stub.
"""

from __future__ import annotations

import re
import textwrap
from pathlib import Path
from typing import Any

from flockstep import _core, keywords

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "envs" / "flockstep"
DOCUMENTS = sorted((ROOT / "docs").rglob("*.md"))
MARKED = re.compile(r"^( *)# fields of (\w+)\n.*?^ *# end of fields\n", re.MULTILINE | re.DOTALL)
MARKED_ARRAYS = re.compile(r"^( *)# arrays of (\w+)\n.*?^ *# end of arrays\n", re.MULTILINE | re.DOTALL)
MARKED_KEYWORDS = re.compile(r"^( *)# keywords of Batch\n.*?^ *# end of keywords\n", re.MULTILINE | re.DOTALL)
MARKED_TASKS = re.compile(r"^# tasks\n.*?^# end of tasks\n", re.MULTILINE | re.DOTALL)
BATCH_PARAMETERS = re.compile(
    r"(^class Batch:\n.*?^    Parameters\n    -+\n)(.*?)(?=^    \"\"\"\n)", re.MULTILINE | re.DOTALL
)
ENTRY = re.compile(r"^    (\w+).*\n(?:        .*\n)+", re.MULTILINE)
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
ENV_KEYWORDS = PACKAGE / "env_keywords.py"
OWN_KEYWORDS = ("autoreset_mode", "drone_mesh")  # of DroneVectorEnv, which defines them itself


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


def batch_fields() -> dict[str, Field]:
    """Return the fields of a batch by their keywords."""
    fields = {field["name"]: field for field in _core._other_fields["BatchConfig"]}
    return {keyword: fields[name] for keyword, name in _core.batch_keywords.items()}


def keyword_type(field: Field) -> str:
    """Return the type of a keyword: one configuration stands for a list of one, and None for the default."""
    text = field["type"].replace("World | None", "World | DroneMesh")
    text = re.sub(r"^Sequence\[(.*)\]$", r"\1 | Sequence[\1]", text)
    return f"{text.removesuffix(' | None')} | None"


def entries(fields: dict[str, Field], indent: str = "    ") -> list[str]:
    """Return the entries of keywords in a section "Parameters"."""
    inner, lines = f"{indent}    ", []
    for name, field in fields.items():
        lines.append(f"{indent}{name}")
        text = re.sub(r"``(\w+s)``", lambda m: f"``{KEYWORDS.get(m[1], m[1])}``", field["about"])
        lines += textwrap.wrap(text, 120, initial_indent=inner, subsequent_indent=inner, break_on_hyphens=False)
    return lines


#: Keywords of the fields of a batch that have another name.
KEYWORDS = {name: keyword for keyword, name in _core.batch_keywords.items() if name != keyword}


ENV_TEXT = '''"""The keywords of `DroneVectorEnv` that are fields of configurations; made by bindings/stubs.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypedDict

if TYPE_CHECKING:
    from flockstep._core import (
{imports}
    )


class EnvKeywords(TypedDict, total=False):
    """Keywords of `DroneVectorEnv`: fields of its `Recipe` and of configurations. The task sets their defaults.

    Parameters
    ----------
{entries}

{lists}
    """

{types}
'''


def env_keywords() -> str:
    """Return the module env_keywords."""
    of_batch = {name: field for name, field in batch_fields().items() if name not in OWN_KEYWORDS}
    types = {name: keyword_type(field) for name, field in of_batch.items()}
    lists = []
    titles = {config: f"the {name} task" for name, config in _core.engine_tasks.items()}
    for config in (*keywords.CONFIGS.values(), *_core.engine_tasks.values()):
        fields = {name: text for name, text in types_of(config).items() if name in keywords.FLAT - {*OWN_KEYWORDS}}
        types |= fields
        names = ", ".join(f"``{name}``" for name in fields)
        text = f"For {titles.get(config, 'every task')}, from `{config.__name__}`, which documents them: {names}."
        if fields:
            lists.append(textwrap.fill(text, 120, initial_indent=" " * 8, subsequent_indent=" " * 8))
    used = {name for text in types.values() for name in re.findall(r"\w+", re.sub('".*?"', "", text))}
    imports = "\n".join(f"        {name}," for name in sorted(used) if hasattr(_core, name))
    lines = [part for name, text in types.items() for part in folded(f"    {name}: {text}")]
    parts = {"entries": "\n".join(entries(of_batch)), "lists": "\n\n".join(lists), "types": "\n".join(lines)}
    return ENV_TEXT.format(imports=imports, **parts)


def batch_keywords(indent: str) -> list[str]:
    """Return the keywords of `Batch` that are fields of its configuration."""
    types = {name: keyword_type(field) for name, field in batch_fields().items()}
    types |= {other: types[name] for other, name in KEYWORDS.items()}
    lines = [f"{indent}{name}: {text} = None," for name, text in types.items()]
    return [part for line in lines for part in folded(line)]


def batch_parameters(match: re.Match[str]) -> str:
    """Return the section "Parameters" of `Batch`: its own entries, then the fields."""
    own = [found[0] for found in ENTRY.finditer(match[2]) if found[1] not in {*batch_fields(), *KEYWORDS}]
    meant = ", ".join(f"``{name}``" for name in KEYWORDS.values())
    lines = [*entries(batch_fields()), f"    {', '.join(KEYWORDS)}", f"        Other names of {meant}."]
    return match[1] + "".join(own) + "\n".join(lines) + "\n"


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


def with_fields(path: Path) -> str:
    """Return a Python file's text with the fields of configurations and their docstrings regenerated."""
    text = path.read_text(encoding="utf-8")
    new, end = "", 0
    for match in MARKED.finditer(text):
        indent, config = match.group(1), getattr(_core, match.group(2))
        before = text[end : match.start()]
        head, section, rest = before.rpartition(f"{indent}Parameters\n")
        if section and rest.endswith('"""\n\n') and rest.count('"""') == 1:
            if hasattr(config, "_words"):
                head = head[: head.rindex('"""') - len(indent)] + "\n".join(words(indent, config)) + "\n"
            before = head + "\n".join(parameters(indent, config)) + "\n"
        lines = class_body(indent, config)
        new += before + "\n".join([f"{indent}# fields of {match.group(2)}", *lines, f"{indent}# end of fields"]) + "\n"
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

    def replace_keywords(match: re.Match[str]) -> str:
        indent = match.group(1)
        return "\n".join([f"{indent}# keywords of Batch", *batch_keywords(indent), f"{indent}# end of keywords"]) + "\n"

    if path == ENV_KEYWORDS:
        return env_keywords()
    tasks = " | ".join(config.__name__ for config in _core.engine_tasks.values())
    text = MARKED_FIELDS.sub(replace_fields, with_fields(path))
    if path.suffix == ".pyi":
        text = BATCH_PARAMETERS.sub(batch_parameters, MARKED_KEYWORDS.sub(replace_keywords, text))
        text = MARKED_TASKS.sub(f"# tasks\n_EngineTask: TypeAlias = (\n    {tasks}\n)\n# end of tasks\n", text)
    return MARKED_TABLE.sub(replace_table, MARKED_ARRAYS.sub(replace_arrays, text))


if __name__ == "__main__":
    from renew import renew  # beside this file

    renew({path: renewed(path) for path in (PACKAGE / "_core.pyi", ENV_KEYWORDS, *DOCUMENTS)})
