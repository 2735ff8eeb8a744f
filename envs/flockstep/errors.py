"""Exceptions of this package that are of two kinds."""

from __future__ import annotations

from gymnasium.error import ClosedEnvironmentError


class ClosedError(ClosedEnvironmentError, RuntimeError):
    """An environment is used after `close`."""


class MissingFileError(FileNotFoundError, ValueError):
    """A file does not exist."""
