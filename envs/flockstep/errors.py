"""Errors of callers: exceptions that are of two kinds, checks of arrays, and hints for misspelt names."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.error import ClosedEnvironmentError

from flockstep._core import _nearest_name


class ClosedError(ClosedEnvironmentError, RuntimeError):
    """An environment is used after `close`."""


class MissingFileError(FileNotFoundError, ValueError):
    """A file does not exist."""


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return ``". Did you mean 'goal'?"`` with the known name most similar to a misspelt one, or ``""``."""
    nearest = _nearest_name(str(name), list(known))
    return f". Did you mean {nearest!r}?" if nearest else ""


def refuse_masked(name: str, value: Any) -> None:
    """Raise ValueError for a masked array, whose mask would be lost."""
    if isinstance(value, np.ma.MaskedArray):
        raise ValueError(f"{name}: expected an array without a mask, got a masked array: call filled() first")


def real_array(name: str, values: npt.ArrayLike) -> npt.NDArray[Any]:
    """Return an array of real numbers.

    Raises
    ------
    ValueError
        It has a mask, or its numbers are complex.
    """
    refuse_masked(name, values)
    array = np.asarray(values)
    if array.dtype.kind == "c":
        raise ValueError(f"{name}: expected real numbers, got {array.dtype}")
    return array
