"""Find differences between two values or two runs."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from flockstep.testing.runs import Array, Step


def difference_between(a: Any, b: Any) -> str | None:
    """Describe the first difference between two values in type, shape or bits, or return None."""
    if type(a) is not type(b):
        return f"{type(a).__name__} against {type(b).__name__}"
    if isinstance(a, dict):
        if a.keys() != b.keys():
            return f"keys {sorted(a)} against {sorted(b)}"
        return next((f"[{key!r}] {d}" for key in a if (d := difference_between(a[key], b[key]))), None)
    if isinstance(a, (tuple, list)):
        if len(a) != len(b):
            return f"length {len(a)} against {len(b)}"
        return next(
            (f"[{i}] {d}" for i, (x, y) in enumerate(zip(a, b, strict=True)) if (d := difference_between(x, y))), None
        )
    if isinstance(a, np.ndarray):
        if a.dtype != b.dtype or a.shape != b.shape:
            return f"{a.dtype} {a.shape} against {b.dtype} {b.shape}"
        if a.dtype == object:
            return difference_between(a.tolist(), b.tolist())
        if np.array_equal(a, b, equal_nan=a.dtype.kind in "fc"):
            return None
        if not a.ndim:
            return f"{a} against {b}"
        differs = ((a != b) & ((a == a) | (b == b))).reshape(len(a), -1)  # NaN equals NaN
        rows = np.flatnonzero(differs.any(axis=1))
        x, y = (array.reshape(len(a), -1)[rows[0]] for array in (a, b))
        where = f"rows {rows[:5].tolist()}"
        if x.size > _MOST_SHOWN:
            numbers = np.flatnonzero(differs[rows[0]])
            where += f", {len(numbers)} of {x.size} numbers, the first at index {numbers[0]}"
            x, y = x[numbers[0]], y[numbers[0]]
        return f"{where}: {x} against {y}"
    return None if bool(a == b) or (a != a and b != b) else f"{a!r} against {b!r}"


_MOST_SHOWN = 4  # numbers of a row in a message


def rows_of(value: Any, rows: slice) -> Any:
    """Return the rows of some envs from a value with a row per env."""
    if isinstance(value, Step):
        return Step(*(rows_of(getattr(value, field.name), rows) for field in fields(Step)))
    if isinstance(value, dict):
        return {key: rows_of(part, rows) for key, part in value.items()}
    if isinstance(value, tuple):
        return tuple(rows_of(part, rows) for part in value)
    return value[rows]


def assert_same_runs(first: tuple[Any, list[Step]], second: tuple[Any, list[Step]], rule: str) -> None:
    """Raise AssertionError with the broken rule if two runs differ."""
    difference = difference_between(first[0], second[0])
    assert difference is None, (
        f"{rule}, but the observations of the reset differ: {_moved(first[1][:1], second[1][:1])}{difference}"
    )
    for number, (a, b) in enumerate(zip(first[1], second[1], strict=True)):
        for name in ("observation", "reward", "terminated", "truncated"):
            difference = difference_between(getattr(a, name), getattr(b, name))
            after = slice(number + 1, number + 2)
            assert difference is None, (
                f"{rule}, but {name} of step {number} differs: {_moved(first[1][after], second[1][after])}{difference}"
            )
        difference = difference_between(_masked(a.infos), _masked(b.infos))
        assert difference is None, f"{rule}, but the infos of step {number} differ: {difference}"


def _moved(first: list[Step], second: list[Step]) -> str:
    """Name the first array of the batch that differs before a step, if one does."""
    for a, b in zip(first, second, strict=True):
        for name in a.before:
            difference = difference_between(a.before[name], b.before[name])
            if difference is not None:
                return f"the drones have another {name} (batch.{name}, {difference}); "
    return ""


def _masked(infos: dict[str, Any]) -> dict[str, Any]:
    """Return the infos without masked-out parts: entries whose mask is all False, and values outside the mask."""
    kept: dict[str, Any] = {}
    for key, value in infos.items():
        if key.startswith("_"):
            continue
        mask = infos.get(f"_{key}")
        if mask is not None and not np.any(mask):
            continue
        if isinstance(value, dict):
            value = _masked(value)
        elif mask is not None and isinstance(value, np.ndarray):
            value = [part if has else None for part, has in zip(value, mask, strict=True)]
        kept[key] = value
    return kept


def arrays_in(value: Any) -> list[Array]:
    """Return all arrays in a dict, tuple or list of arrays, or the array itself."""
    if isinstance(value, dict):
        return [leaf for key in sorted(value) for leaf in arrays_in(value[key])]
    if isinstance(value, (tuple, list)):
        return [leaf for part in value for leaf in arrays_in(part)]
    return [value] if isinstance(value, np.ndarray) else []
