"""Writes generated files, or checks that they are up to date."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path


def renew(texts: Mapping[Path, str]) -> None:
    """Write the files whose text differs. With ``--check`` on the command line, print their names and exit with 1."""
    stale = [path for path, text in texts.items() if path.read_text(encoding="utf-8") != text]
    if "--check" not in sys.argv:
        for path in stale:
            path.write_text(texts[path], encoding="utf-8")
    elif stale:
        for path in stale:
            print(f"{path.name}: it differs from what the module says; run {sys.argv[0]}")
        sys.exit(1)
