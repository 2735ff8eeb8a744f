"""Hints for misspelt names in messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(name: object, known: Iterable[str]) -> str:
    """Return ``". Did you mean 'goal'?"`` with the known name most similar to a misspelt one, or ``""``."""
    nearest = difflib.get_close_matches(str(name), list(known), n=1)
    return f". Did you mean {nearest[0]!r}?" if nearest else ""
