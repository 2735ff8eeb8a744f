"""Checks of array arguments."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


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
