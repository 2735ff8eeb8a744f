"""Hints for misspelt names in messages."""

from __future__ import annotations

from collections.abc import Iterable

from flockstep._core import _nearest_name


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return ``". Did you mean 'goal'?"`` with the known name most similar to a misspelt one, or ``""``."""
    nearest = _nearest_name(str(name), list(known))
    return f". Did you mean {nearest!r}?" if nearest else ""
