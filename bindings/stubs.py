"""Generates the stub of the module, and the parts of documents that come from lists in the engine.

usage: stubs.py --stub FOLDER FILE: writes the stub of the module in a folder; the build does that
       stubs.py [--check]: renews or compares the rest; run it with the module built after a change of such a list

The stub is bindings/core.pyi with these parts replaced: "# configurations" by the classes that stand nowhere else, "#
fields of A" by attributes and __init__ (the docstring above becomes the run-time one, which lists the fields), "#
arrays of A" by properties, "**fields: Fields[A]" by keywords with their defaults, "Changes[A]" by keywords that are
None by default, and "Arguments[A]" by arguments, of which the first is required. documents.py replaces marks such as
"{planning.hpp: Each place has}".

"# tasks" stands for the type _EngineTask, "# lists of sensors" for properties of a batch with the configurations of
sensors that it defines no property for. The parameters of a class in _core._arguments end with these arguments.

Without --stub, it writes the parts of docs/ between "<!-- arrays of A, B -->" and "<!-- end of arrays -->", "<!--
fields of A -->" and "<!-- end of fields -->" (of "fields of A, B" those that both have alike, which the tables of A and
of B leave out), and the whole of envs/flockstep/env_keywords.py, client/changes.py and learning/arguments.py.
"""

from __future__ import annotations

import importlib
import inspect
import re
import sys
import textwrap
from pathlib import Path
from typing import Any

from documents import with_comments  # beside this file

if "--stub" in sys.argv:  # the package itself is not installed yet
    sys.path.insert(0, sys.argv[2])
_core: Any = importlib.import_module("_core" if "--stub" in sys.argv else "flockstep._core")

ROOT = Path(__file__).resolve().parents[1]
TEMPLATE = ROOT / "bindings" / "core.pyi"
DOCUMENTS = sorted((ROOT / "docs").rglob("*.md"))
MARKED_TABLE = re.compile(r"^<!-- arrays of ([\w, ]+) -->\n.*?^<!-- end of arrays -->\n", re.MULTILINE | re.DOTALL)
MARKED_FIELDS = re.compile(r"^<!-- fields of ([\w, ]+) -->\n.*?^<!-- end of fields -->\n", re.MULTILINE | re.DOTALL)
FIELDS = re.compile(r'(?:"""(?:(?!""").)*"""\n\n)?    # fields of (\w+)\n', re.DOTALL)
ARRAYS = re.compile(r"    # arrays of (\w+)\n")
STAND_INS = re.compile(r"\*\*fields: (Fields|Changes|Arguments)\[(\w+)\]")
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
#: Values that configs.md says once, for all fields.
SAID_ONCE = ("letters, digits, _ and -", "a unit quaternion", "within +-1e+06 m", "within +-1e+06", "[0.05, 20]")
OWN_KEYWORDS = ("autoreset_mode", "drone_mesh")  # of DroneVectorEnv, which defines them itself


def folded(line: str) -> list[str]:
    """Return a line as ruff formats it: a list that is too long gets one line per item."""
    found = re.match(r"^( *)(.*Literal\[)(.*)(\].*)$", line)
    if len(line) <= 120 or not found:
        return [line]
    indent, head, items, tail = found.groups()
    return [indent + head, *(f"{indent}    {item}," for item in items.split(", ")), indent + tail]


def values_text(field: Field) -> str:
    """Return the values of a field: choices, limits, or its type if the default does not show it."""
    kind = field["type"].removesuffix(" | None")
    values: str = field["values"]
    if kind.startswith("Literal"):
        values = kind.removeprefix("Literal[").removesuffix("]")
    elif not values or kind != field["type"]:
        kind = kind.replace("Sequence", "sequence").replace("[", " of ").replace("]", "")
        between = {"": "", "[": " in ", "(": " in ", ">": " "}.get(values[:1], ", ")
        values = kind + between + values
    return values + (", or None" if field["type"].endswith(" | None") else "")


def limits_text(field: Field) -> str:
    """Return the values of a field for its table, unless its default or its description shows them."""
    values = values_text(field)
    if field["type"].startswith("Literal"):
        return "" if all(choice in field["about"] for choice in values.split(", ")) else values
    if field["values"] in SAID_ONCE:
        return ""
    if field["shown"] in ("None", "[]"):
        return values.removesuffix(", or None").removeprefix("float ").removeprefix("in ")
    return values if field["values"] else ""


def field_table(fields: list[Field]) -> list[str]:
    """Return a table of the fields of a configuration, as keywords; those of a file, in objects, have no default."""
    in_file = any(" " in field["name"] for field in fields)
    lines = ["| field | description |", "|---|---|"]
    for field in fields:
        keyword = field["name"] + ("" if in_file else f"={field['shown']}")
        limits = limits_text(field)
        cells = (f"`{keyword}`" + (f", {limits}" if limits else ""), field["about"].replace("``", "`"))
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return lines


def shared_fields(names: list[str]) -> list[Field]:
    """Return the fields that at least two of several configurations have alike."""
    found = [{**field, "doc": ""} for name in names for field in fields_of(name)]
    return [field for i, field in enumerate(found) if field in found[:i] and field not in found[i + 1 :]]


def fields_of(name: str) -> list[Field]:
    """Return the descriptions of the fields of a configuration, or of the arguments of a class."""
    fields: list[Field] = (_core._arguments | _core._other_fields).get(name) or getattr(_core, name)._fields
    return fields


def docstring(item: Any, indent: str) -> str:
    """Return the run-time docstring of a class or a function."""
    return f'"""{textwrap.indent(inspect.getdoc(item) or "", indent).lstrip()}\n{indent}"""\n'


def class_body(match: re.Match[str]) -> str:
    """Return the docstring, the attributes and the constructor of a configuration."""
    config = getattr(_core, match[1])
    fields = config._fields if hasattr(config, "_fields") else config._attributes
    attributes = "".join(f"    {field['name']}: {field['type']}\n" for field in fields)
    if not hasattr(config, "_fields"):  # a docstring and a constructor of its own
        return match[0].replace(f"    # fields of {match[1]}\n", attributes)
    start = "" if match[0].startswith('"') else "    "
    constructor = f"    def __init__(self, **fields: Fields[{match[1]}]) -> None: ...\n"
    named = "    __match_args__: ClassVar[tuple[str, ...]]\n"
    return f"{start}{docstring(config, '    ')}\n{named}{attributes}{constructor}"


def property_text(name: str, kind: str, doc: str) -> str:
    """Return a property of a class."""
    return f'    @property\n    def {name}(self) -> {kind}:\n        """{doc}"""\n'


def preset_text(name: str) -> str:
    """Return the method with the presets of a configuration, if it has some."""
    preset = getattr(getattr(_core, name), "preset", None)
    head = f"    @staticmethod\n    def preset(product: str) -> {name}:\n        "
    return f'{head}"""{inspect.getdoc(preset)}"""\n' if preset else ""


def array_properties(match: re.Match[str]) -> str:
    """Return the properties of a class that view arrays."""
    arrays = getattr(_core, match[1])._arrays
    return "\n".join(property_text(array["name"], ARRAY_TYPES[array["dtype"]], array["doc"]) for array in arrays)


def results_class(name: str) -> str:
    """Return a class whose objects only calls return."""
    fields = getattr(_core, name)._results
    head = f'    """{getattr(_core, name).__doc__}"""\n\n    __match_args__: ClassVar[tuple[str, ...]]\n'
    return head + "".join(property_text(field["name"], field["type"], field["about"]) for field in fields)


def sensor_lists(template: str) -> str:
    """Return the properties of a batch with the configurations of its sensors, unless the template has them."""
    batch = template.partition("\nclass Batch:\n")[2].partition("\nclass ")[0]
    lists = {field["name"]: field["type"].replace("Sequence", "list") for field in fields_of("BatchConfig")}
    return "\n".join(
        property_text(name, kind, inspect.getdoc(getattr(_core.Batch, name)) or "")
        for name, kind in lists.items()
        if kind.startswith("list[") and hasattr(_core.Batch, name) and f"    def {name}(" not in batch
    )


def arguments(match: re.Match[str]) -> str:
    """Return the arguments that stand for the fields of a configuration."""
    kind, name = match.groups()
    before = match.string[: match.start()].rpartition("def ")[2]
    listed = ["*"] if kind != "Arguments" and "*," not in before else []
    fields = _core._changes.get(name) if kind == "Changes" else None
    for field in fields or fields_of(name):
        of_type = f"{field['name']}: {field['type']}"
        if kind == "Changes":
            of_type = of_type.removesuffix(" | None") + " | None = None"
        elif listed:
            of_type += f" = {field['default']}"
        listed.append(of_type)
    return ", ".join(listed)


def with_docstrings(text: str) -> str:
    """Return the stub with docstrings that list the fields among the arguments of functions."""
    for match in reversed(list(re.finditer(r'    def (\w+)\(\*\*fields: Arguments.*?(""".*?"""\n)', text, re.DOTALL))):
        owner = re.findall(r"^class (\w+)", text[: match.start()], re.MULTILINE)[-1]
        made = docstring(getattr(getattr(_core, owner), match[1]), "        ")
        text = text[: match.start(2)] + made + text[match.end(2) :]
    for name in _core._arguments:
        head, found, rest = text.partition(f"\nclass {name}:\n    ")
        text = head + found + docstring(getattr(_core, name), "    ") + rest.split('"""\n', 1)[1]
    return text


def stub_text() -> str:
    """Return the stub."""
    template = with_comments(TEMPLATE.read_text(encoding="utf-8"))
    named = set(re.findall(r"^class (\w+)", template, re.MULTILINE))
    classes = [name for name, item in vars(_core).items() if hasattr(item, "_fields") and name not in named]
    made = "".join(f"@final\nclass {name}:\n    # fields of {name}\n{preset_text(name)}\n" for name in classes)
    results = [name for name, item in vars(_core).items() if hasattr(item, "_results")]
    made += "".join(f"@final\nclass {name}:\n{results_class(name)}\n" for name in results)
    tasks = " | ".join(config.__name__ for config in _core.engine_tasks.values())
    template = template.replace("# tasks\n", f"_EngineTask: TypeAlias = {tasks}\n")
    template = template.replace("    # lists of sensors\n", sensor_lists(template))
    text = FIELDS.sub(class_body, template.replace("# configurations\n\n", made))
    return STAND_INS.sub(arguments, with_docstrings(ARRAYS.sub(array_properties, text)))


def entry(name: str, about: str, width: int = 120) -> str:
    """Return a parameter of a docstring."""
    text = textwrap.fill(about, width, initial_indent=" " * 8, subsequent_indent=" " * 8, break_on_hyphens=False)
    return f"    {name}\n{text}"


def types_of(config: Any) -> dict[str, str]:
    """Return the types of a configuration's fields."""
    return {field["name"]: field["type"] for field in config._fields}


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
    from flockstep import keywords

    shared = {*_core.batch_keywords} - {*OWN_KEYWORDS}
    of_batch = [argument for argument in _core._arguments["Batch"] if argument["name"] in shared]
    types = {argument["name"]: f"{argument['type']} | None" for argument in of_batch}
    entries = [entry(argument["name"], argument["doc"]) for argument in of_batch]
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
    parts = {"entries": "\n".join(entries), "lists": "\n\n".join(lists), "types": "\n".join(lines)}
    return ENV_TEXT.format(imports=imports, **parts)


CHANGES_TEXT = '''"""The keywords of a client that change configurations; made by bindings/stubs.py."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from flockstep._core import {imports}
'''


def changes() -> str:
    """Return the module client/changes."""
    types = (field["type"] for fields in _core._changes.values() for field in fields)
    used = {name for text in types for name in re.findall(r"\w+", text) if hasattr(_core, name)}
    text = CHANGES_TEXT.format(imports=", ".join(sorted(used)))
    for config, fields in _core._changes.items():
        name = config.removesuffix("Config") + "Changes"
        text += f'\n\nclass {name}(TypedDict, total=False):\n    """Fields of `{config}` that change.\n\n'
        text += "    Parameters\n    ----------\n"
        for field in fields:
            text += entry(field["name"], field["doc"].rpartition(" Default: ")[0], 116) + "\n"
        text += '    """\n\n'
        for field in fields:
            text += f"    {field['name']}: {field['type'].removesuffix(' | None')} | None\n"
    return text


ARGUMENTS_TEXT = '''"""The arguments of `PPO`, in the order of Stable-Baselines3; made by bindings/stubs.py."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from flockstep.learning.sb3_models import Schedule


class Arguments:
    """Takes the arguments of `PPO`.

    Parameters
    ----------
{entries}
    """

{types}

    def __init__(
        self,
{listed}
        **unknown: NoReturn,
    ) -> None:
        self._set_up(
{passed}
            **unknown,
        )

    def _set_up(self, policy: str, env: Any, **others: Any) -> None:
        raise NotImplementedError

    __init__.__qualname__ = "PPO.__init__"
'''


def ppo_arguments() -> str:
    """Return the module learning/arguments: the fields, and what `PPO._set_up` takes besides them."""
    from stable_baselines3 import PPO as SB3

    from flockstep.learning.ppo import PPO
    from flockstep.learning.sb3_models import SCHEDULES

    fields = {field["name"]: field for config in ("RolloutConfig", "UpdateConfig") for field in fields_of(config)}
    fields |= {field["name"]: field for field in fields_of("NetworkConfig") if field["name"] == "critic_only"}
    types = {name: field["type"] for name, field in fields.items()}
    types |= {name: types[name].replace("float", "Schedule") for name in SCHEDULES}
    listed = {}
    _, *own, _ = inspect.signature(PPO._set_up).parameters.values()
    for argument in own:
        default = str(argument.replace(annotation=argument.empty)).removeprefix(argument.name).replace("'", '"')
        listed[argument.name] = f"{argument.name}: {argument.annotation}{default.replace('=', ' = ')}"
    listed |= {name: f"{name}: {kind} = {fields[name]['default']}" for name, kind in types.items()}
    positional = [name for name in inspect.signature(SB3).parameters if name in listed]
    names = [*positional, *(name for name in listed if name not in positional)]
    fields = {name: fields[name] for name in names if name in fields}
    lines = [f"        {listed[name]}," for name in names]
    lines.insert(len(positional), "        *,")
    more = " A number, or a function of the remaining share of the training, which falls from 1 to 0."
    return ARGUMENTS_TEXT.format(
        entries="\n".join(entry(name, fields[name]["about"] + more * (name in SCHEDULES)) for name in fields),
        types="\n".join(f"    {name}: {types[name]}" for name in fields),
        listed="\n".join(lines),
        passed="\n".join(f"            {name}={name}," for name in names),
    )


PACKAGE = ROOT / "envs" / "flockstep"
MADE = {
    PACKAGE / "env_keywords.py": env_keywords,
    PACKAGE / "client" / "changes.py": changes,
    PACKAGE / "learning" / "arguments.py": ppo_arguments,
}


def array_table(classes: list[type[Any]]) -> list[str]:
    """Return a table of the arrays of some classes."""
    lines = ["| array | type, unit, frame | content |", "|---|---|---|"]
    for cls in classes:
        owners = {"Contact": "contact.", "Lidar": "lidar().", "Camera": "camera().", "Bodies": "bodies."}
        owner = owners.get(cls.__name__, "")
        for array in cls._arrays:
            measured = [text for text in (array["unit"], array["frame"]) if text not in ("", "1")]
            kind = ", ".join([f"{array['dtype']} {array['shape']}".removeprefix("float32 "), *measured])
            lines.append(f"| `{owner}{array['name']}` | {kind} | {array['about']} |")
    return lines


def renewed(path: Path) -> str:
    """Return a file's text with its marked parts regenerated."""

    def replace_table(match: re.Match[str]) -> str:
        lines = array_table([getattr(_core, name.strip()) for name in match.group(1).split(",")])
        return "\n".join([f"<!-- arrays of {match.group(1)} -->", *lines, "<!-- end of arrays -->"]) + "\n"

    def replace_fields(match: re.Match[str]) -> str:
        names = match[1].split(", ")
        fields = shared_fields(names) if len(names) > 1 else own_fields(names[0])
        return "\n".join([f"<!-- fields of {match[1]} -->", *field_table(fields), "<!-- end of fields -->", ""])

    def own_fields(name: str) -> list[Field]:
        """Return the fields of a configuration that no table of several configurations of the page lists."""
        several = [found[1].split(", ") for found in MARKED_FIELDS.finditer(text) if "," in found[1]]
        shared = [field for names in several if name in names for field in shared_fields(names)]
        return [field for field in fields_of(name) if {**field, "doc": ""} not in shared]

    if path in MADE:
        return MADE[path]()
    text = path.read_text(encoding="utf-8")
    return MARKED_TABLE.sub(replace_table, MARKED_FIELDS.sub(replace_fields, text))


if __name__ == "__main__":
    if "--stub" in sys.argv:
        Path(sys.argv[3]).write_text(stub_text(), encoding="utf-8")
    else:
        from renew import renew  # beside this file

        renew({path: renewed(path) for path in (*MADE, *DOCUMENTS)})
