"""Generates the schema and the tables of scene files from the module's list of their keys; --check only compares.

Writes ``scenes/schema.json`` and the part of ``docs/reference/scene-format.md`` between "<!-- scene keys -->" and
"<!-- /scene keys -->". Run it with the module built after a change of ``engine/src/world/scene_keys.hpp``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flockstep import _core

ROOT = Path(__file__).resolve().parents[1]
SCHEMA = ROOT / "scenes" / "schema.json"
DOCUMENT = ROOT / "docs" / "reference" / "scene-format.md"
BEGIN, END = "<!-- scene keys -->\n", "<!-- /scene keys -->\n"
WIDTH = 120
#: Limits of positions, which the text of the page says.
COORDINATE = " in [-1e6, 1e6]"
#: Keys of every solid, which the text of the page says, too.
OF_SOLIDS = ("material", "visible", "solid")
#: Keys whose own keys another page lists.
ELSEWHERE = {"light": "[configs.md](configs.md#light)"}

ABOUT = (
    "A world: its solids, their materials, and the places that a task reads. Positions are in the world frame "
    "(right-handed, x east, y north, z up). Numbers are rounded to float32. Rules that a schema cannot express: names "
    "of materials and textures are listed, min is below max, a capsule is at least as high as its caps, vertex indices "
    "are in range, triangles have an area."
)

Key = dict[str, Any]  # a key from _core._scene_keys()
Schema = dict[str, Any]

# -------------------------------------------------------------------------------------------------------------- schema


def either(options: Sequence[Sequence[Key]]) -> list[Schema]:
    """Return a schema for each alternative: it requires its keys and forbids those of the others."""
    schemas = []
    for option in options:
        others = [{"required": [key["name"]]} for other in options if other is not option for key in other]
        needed = [key["name"] for key in option if key["required"]]
        schemas.append({"required": needed, "not": others[0] if len(others) == 1 else {"anyOf": others}})
    return schemas


def object_schema(keys: Sequence[Key]) -> Schema:
    """Return the schema of an object with these keys."""
    schema: Schema = {"type": "object"}
    required = [key["name"] for key in keys if key["required"] and not key["alternative"]]
    if required:
        schema["required"] = required
    numbers = sorted({key["alternative"] for key in keys} - {0})
    if numbers:
        schema["oneOf"] = either([[key for key in keys if key["alternative"] == number] for number in numbers])
    if {"visible", "solid"} <= {key["name"] for key in keys}:  # a solid must be visible or solid
        neither: Schema = {name: {"const": False} for name in ("visible", "solid")}
        schema["not"] = {"required": list(neither), "properties": neither}
    schema["additionalProperties"] = False
    schema["properties"] = {key["name"]: key_schema(key) for key in keys}
    return schema


def value_schema(key: Key) -> Schema:
    """Return the schema of a single value, such as a coordinate of a point."""
    kind = key["kind"]
    if kind == "anything":
        return {}
    if kind == "version":
        return {"const": key["version"]}
    if kind == "text":
        return {"type": "string"}
    if kind == "text_or_texts":
        return {"oneOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}
    if kind == "flag":
        return {"type": "boolean"}
    if kind == "choice":
        return {"enum": key["choices"]}
    if kind == "object":
        return object_schema(key["keys"])
    if kind == "config":
        return {"type": "object"}
    if kind == "index":
        return {"type": "integer", "minimum": 0}
    limits = {word: plain(key[end]) for word, end in (("minimum", "least"), ("maximum", "greatest")) if end in key}
    within = {"anyOf": [{"const": 0}, limits]} if key.get("or_zero") else limits
    return {"type": "integer" if kind == "integer" else "number", **within}


def key_schema(key: Key) -> Schema:
    """Return the schema of the value or values of a key."""
    schema = value_schema(key)
    size, count = key["size"], key["count"]
    if size:
        schema = {"type": "array", "items": schema, "minItems": size, "maxItems": size}
        if key["kind"] == "direction":
            schema["not"] = {"items": {"const": 0}}
    if count == "list":
        schema = {"type": "array", "items": schema} | ({"maxItems": key["most"]} if "most" in key else {})
    elif count == "by_name":
        schema = {"type": "object", "maxProperties": key["most"], "additionalProperties": schema}
    about = key["meaning"] + (f" Unit: {key['unit']}." if key["unit"] else "")
    return {"description": about, **schema, **({"default": key["default"]} if "default" in key else {})}


def some_solid(keys: Sequence[Key]) -> list[Schema]:
    """Return schemas, one of which a scene must match: it has a room, or something solid in one of its lists."""
    options: list[Schema] = [{"required": ["room"]}]
    for key in keys:
        names = {inner["name"] for inner in key.get("keys", ())}
        if "solid" not in names:
            continue
        one: Schema = {"solid": {"const": True}} | ({"triangles": {"minItems": 1}} if "triangles" in names else {})
        options.append({"required": [key["name"]], "properties": {key["name"]: {"contains": {"properties": one}}}})
    return options


def schema_text(keys: Sequence[Key]) -> str:
    """Return the text of schema.json."""
    ends_of_pillars = {"properties": {"pillars": {"items": {"required": ["z"]}}}}
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "flockstep scene",
        "description": ABOUT,
        **object_schema(keys),
        "allOf": [{"anyOf": some_solid(keys)}, {"anyOf": [{"required": ["room"]}, ends_of_pillars]}],
    }
    return written(schema) + "\n"


def plain(number: float) -> float:
    """Return a whole number as an int: 4, not 4.0."""
    return int(number) if number == int(number) else number


def written(value: Any, indent: str = "", used: int = 0) -> str:
    """Return JSON on one line if it fits, otherwise with a line per item. ``used`` is the number of columns in use."""
    line = json.dumps(value)
    if not isinstance(value, (dict, list)) or len(indent) + used + len(line) < WIDTH:
        return line
    deeper = indent + "  "
    if isinstance(value, list):
        return "[\n" + ",\n".join(deeper + written(item, deeper) for item in value) + f"\n{indent}]"
    items = [(json.dumps(name) + ": ", item) for name, item in value.items()]
    lines = [deeper + name + written(item, deeper, len(name)) for name, item in items]
    return "{\n" + ",\n".join(lines) + f"\n{indent}}}"


# --------------------------------------------------------------------------------------------------------------- table


def number_text(number: float) -> str:
    """Return a number in the format of the tables: 1e-6, 65532."""
    return f"{number:.6g}".replace("e-0", "e-").replace("e+0", "e")


def shown_keys(key: Key) -> list[str]:
    """Return the names of the keys of an object, without those of every solid, which the page names once."""
    names = [inner["name"] for inner in key.get("keys", ())]
    return [name for name in names if name not in OF_SOLIDS] if "solid" in names else names


def values_text(key: Key) -> str:
    """Describe the allowed values of a key."""
    kind, size = key["kind"], key["size"]
    limits = f" in [{number_text(key['least'])}, {number_text(key['greatest'])}]" if "least" in key else ""
    if limits == COORDINATE and key["unit"] == "m":
        limits = ""
    words = {
        "anything": "anything",
        "version": str(key.get("version")),
        "text": "text",
        "text_or_texts": "text, or a list of texts",
        "flag": "true or false",
        "number": f"{size} numbers{limits}" if size else f"a number{limits}",
        "integer": f"an integer{limits}",
        "index": f"{size} indices",
        "direction": f"{size} numbers{limits}, not all 0",
        "choice": (f"{size} of " if size else "one of ")
        + ", ".join(f'`"{choice}"`' for choice in key.get("choices", ())),
        "object": f"an object as in {ELSEWHERE[key['name']]}"
        if key["name"] in ELSEWHERE
        else ", ".join(f"`{name}`" for name in shown_keys(key)),
        "config": "objects as in [configs.md](configs.md#bodies)",
    }
    text = ("0 or " if key.get("or_zero") else "") + words[kind] + (f", {key['unit']}" if key["unit"] else "")
    most = f" (at most {key['most']:,})" if "most" in key else ""
    return {"one": "", "list": "list of ", "by_name": "by name: "}[key["count"]] + text + most


def default_text(key: Key, siblings: Sequence[Key]) -> str:
    """Describe the default of a key."""
    if "default" in key:
        return f"`{json.dumps(key['default'])}`"
    if not key["required"]:
        return ""
    others = [other for other in siblings if other["required"] and other["alternative"] not in (0, key["alternative"])]
    names = " and ".join(f"`{other['name']}`" for other in others if key["alternative"])
    return "required" + (f", or {names}" if names else "")


def values_and_default(key: Key, default: str) -> str:
    """Describe the allowed values of a key, and its default."""
    said = default if default.startswith("required") or not default else f"default {default}"
    return values_text(key) + (f" ({said})" if said else "")


def tables_text(keys: Sequence[Key]) -> str:
    """Return the tables of docs/reference/scene-format.md: the keys of a scene and of its objects, each listed once."""
    rows: list[tuple[Key, str, list[str]]] = []

    def add(owner: str, inner: Sequence[Key]) -> None:
        for key in inner:
            known = next((owners for other, _, owners in rows if other == key), None)
            if known is None:
                rows.append((key, default_text(key, inner), known := []))
            known.append(f"`{owner}`")
            add_inner(key)

    def add_inner(key: Key) -> None:
        if key["name"] not in ELSEWHERE:
            add(key["name"], key.get("keys", ()))

    text = "| key | values | what |\n|---|---|---|\n"
    for key in keys:
        text += f"| `{key['name']}` | {values_and_default(key, default_text(key, keys))} | {key['meaning']} |\n"
        add_inner(key)
    names: dict[tuple[str, str], list[str]] = {}  # by values and meaning
    for key, default, owners in rows:
        others = [len(of) for other, _, of in rows if other["name"] == key["name"] and of is not owners]
        is_rule = len(owners) > 1 + max(others, default=-1)  # of all objects that no other row of the key names
        name = f"`{key['name']}`" + ("" if is_rule else f" of {', '.join(owners)}")
        names.setdefault((values_and_default(key, default), key["meaning"]), []).append(name)
    text += "\n| key | values | what |\n|---|---|---|\n"
    return text + "".join(f"| {', '.join(alike)} | {values} | {what} |\n" for (values, what), alike in names.items())


def document_text(text: str, keys: Sequence[Key]) -> str:
    """Return a document with its tables regenerated."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return before + BEGIN + tables_text(keys) + END + after


# ---------------------------------------------------------------------------------------------------------------- main


def renewed() -> dict[Path, str]:
    """Return the text that each file should have."""
    keys: list[Key] = json.loads(_core._scene_keys())
    return {SCHEMA: schema_text(keys), DOCUMENT: document_text(DOCUMENT.read_text(encoding="utf-8"), keys)}


if __name__ == "__main__":
    from renew import renew  # beside this file

    renew(renewed())
