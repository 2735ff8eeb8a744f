"""Checks of messages by tests: the field it refuses and the values it holds, not its words.

    with refused(ValueError, "lidar.num_channels", 0):
        ...

The exact words of messages stand in project/test_messages.py alone.
"""

from __future__ import annotations

import re
from typing import Any

import pytest


def whole(text: str) -> str:
    """A pattern of this text that is not part of a longer word or number."""
    before = r"(?<![\w.-])" if text[:1].isdigit() else r"(?<!\w)" if text[:1].isalpha() else ""
    after = r"(?!\w|\.\d)" if text[-1:].isalnum() else ""
    return before + re.escape(text) + after


def message(field: str, *values: Any) -> str:
    """A pattern of a message that begins with a field, or of a free sentence with it, and holds each value."""
    begins = re.escape(field) + (r"(?![\w.])" if field[-1:].isalnum() else "")
    sentence = r"(?![\w.\[\]'\"]+: ).*" + whole(field)
    holds = ""
    for value in values:
        texts = {repr(value), value.__name__ if isinstance(value, type) else str(value)}
        holds += f"(?=.*(?:{'|'.join(whole(text) for text in sorted(texts))}))"
    return f"(?s)^{holds}(?:{begins}|{sentence})"


def refused(kind: type[BaseException] | tuple[type[BaseException], ...], field: str, *values: Any) -> Any:
    """Expect an error, or a warning, of this kind that is about a field and holds these values, as repr or text."""
    pattern = message(field, *values)
    if isinstance(kind, type) and issubclass(kind, Warning):
        return pytest.warns(kind, match=pattern)
    return pytest.raises(kind, match=pattern)
