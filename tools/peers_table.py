"""Writes docs/results/comparison.md, the comparison with other simulators, from docs/peers.yaml.

Run it by ``-m tools.peers_table [--check]``.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

ROOT = Path(__file__).resolve().parents[1]
PEERS = ROOT / "docs" / "peers.yaml"
PAGE = ROOT / "docs" / "results" / "comparison.md"
SOURCE = r"https://[^\s/]+\.[^\s]+|[\w-]+ \d+(\.\d+)+"  # a page, or a package's version


def table(content: Any) -> str:
    """Return the table of all features; exit if a cell or the documentation of a peer has no source."""
    peers, columns = content["peers"], ["flockstep", *content["peers"]]
    sources = {peer: [peers[peer]["documentation"]] for peer in peers}
    lines = [f"| | {' | '.join(columns)} |", f"|{'---|' * (len(columns) + 1)}"]
    for feature, row in content["rows"].items():
        if unknown := set(row) - set(columns):
            sys.exit(f"{PEERS.name}: {feature}: expected one of {', '.join(columns)}, got {unknown}")
        sources |= {f"{feature}, {peer}": cell[1:] for peer, cell in row.items() if peer in peers}
        texts = [row["flockstep"], *(row[peer][0] if peer in row else "\N{EN DASH}" for peer in peers)]
        lines.append(f"| {feature} | {' | '.join(texts)} |")
    for cell, given in sources.items():
        if not given or not all(re.fullmatch(SOURCE, source) for source in given):
            sys.exit(
                f"{PEERS.name}: {cell}: expected a source, an https address or a package with its version, got {given}"
            )
    return "\n".join(lines)


def main() -> None:
    """Write the table, or compare it."""
    old = PAGE.read_text(encoding="utf-8")
    before, _, rest = old.partition("<!-- peers -->\n")
    new = f"{before}<!-- peers -->\n{table(YAML(typ='safe').load(PEERS))}\n{rest[rest.index('<!-- /peers -->') :]}"
    if "--check" not in sys.argv:
        PAGE.write_text(new, encoding="utf-8")
    elif new != old:
        sys.exit(f"{PAGE.name}: the comparison differs from {PEERS}: run python -m tools.peers_table")


if __name__ == "__main__":
    main()
