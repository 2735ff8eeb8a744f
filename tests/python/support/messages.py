"""The wording of messages, in one place: tests say which field is refused, why, and with which values.

    with refused("Broken.markers", "another name", "start", "home"):
        ...

A reason has the kind of error and the words after the field. Its gaps {} take values; "..." stands for any words.
"""

from __future__ import annotations

import re
from typing import Any

import pytest

TARGETS = "positions (N, 3), or a pair of positions and quaternions (N, 4)"

REASONS: dict[str, tuple[type[Exception], str]] = {
    # values of any field
    "range": (ValueError, "expected an integer in [{}, {}], got {!r}"),
    "count": (ValueError, "expected an integer >= 1, got {!r}"),
    "above 0": (ValueError, "expected a finite number above 0, got {!r}"),
    "mask": (ValueError, "expected an array without a mask, got a masked array: call filled"),
    "two values": (TypeError, "expected one value, got {}={!r} and {}.{}={!r}"),
    # names
    "a text": (TypeError, "expected a tuple of names, got {0!r}: write ({0!r},)"),
    "no names": (TypeError, "expected a tuple of names, got "),
    "no name": (ValueError, "expected at least one name, got ()"),
    "same name": (ValueError, "expected different names, got {!r} twice"),
    "another name": (ValueError, "expected names among {}, ..., got {!r}"),
    "taken name": (ValueError, "expected names that are not taken (...), got {!r}"),
    "misspelt": (TypeError, " resembles a name of Task. Did you mean {!r}?"),
    # keywords
    "on a task": (TypeError, "envs do not read it from a task: {}"),
    "own observation": (TypeError, "the NavigationConfig has its own: set Nav"),
    # what a task returns
    "pair": (ValueError, "expected a pair (reward, terminated), got {}"),
    "target": (ValueError, f"expected {TARGETS}, got {{}}"),
    "commands": (ValueError, "expected commands (N, 4), got {}"),
    "default act": (TypeError, "the default act returns positions, but control={!r} needs commands"),
    "default action": (TypeError, "the default act takes a Box (3,), got ...: override"),
    "type": (ValueError, "expected {}, as the space says, got {}"),
    "no type": (TypeError, "expected one of the types bool, ..., got {}"),
    "shape": (ValueError, "expected shape {}, got {}"),
    "shape of": (ValueError, "expected a {} of shape {}, got {}"),
    "reward": (ValueError, "expected a reward of {}"),
    "flag": (ValueError, "expected {} to be bool, got {}"),
    "integers": (ValueError, "expected integers that fit {}, got {}"),
    "no box": (ValueError, "...expected a Box with at least one value, got ...{}"),
    "missing": (NotImplementedError, "every task has to define it"),
    "outside": (RuntimeWarning, "expected numbers in [{}, {}], as the space says, got {} in env {} at index {}"),
    "not finite": (RuntimeWarning, " is {} in env {}"),
}


def refused(field: str, reason: str, *values: Any) -> Any:
    """Expect an error, or a warning, that begins with a field and gives this reason, with these values."""
    kind, words = REASONS[reason]
    said = words.format(*values)
    text = field + ("" if said.startswith(" ") else ": ") + said
    pattern = "^" + ".*".join(re.escape(part) for part in text.split("..."))
    return pytest.warns(kind, match=pattern) if issubclass(kind, Warning) else pytest.raises(kind, match=pattern)
