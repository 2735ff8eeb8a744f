"""The command ``flockstep view``."""

from __future__ import annotations

import argparse
import sys
import webbrowser
from pathlib import Path

from flockstep.progress_line import ProgressLine
from flockstep.viewer import page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``view``."""
    about = "recording, .mcap or .html"
    parser.add_argument("recording", metavar="RECORDING", type=Path, help=about)
    parser.add_argument("ghost", metavar="GHOST", type=Path, nargs="?", help="a second one, as a ghost or side by side")
    out = "page to write; default: RECORDING.view.html, or no new page for one .html"
    parser.add_argument("--out", metavar="PAGE", type=Path, help=out)
    parser.set_defaults(run=main)


def main(arguments: argparse.Namespace) -> None:
    """Show the recordings; exit with status 2 if an argument is not one."""
    try:
        _show(arguments)
    except ValueError as error:
        print(f"flockstep view: {error}"[:200], file=sys.stderr)
        sys.exit(2)


def _show(arguments: argparse.Namespace) -> None:
    """Write a page if there is none yet, print its path, and open it if there is a display."""
    paths: list[Path] = [path for path in (arguments.recording, arguments.ghost) if path is not None]
    out: Path | None = arguments.out
    if out is not None and out.suffix.lower() != ".html":
        raise ValueError(f"out: expected a name that ends with .html, got {str(out)!r}")
    if out is not None and out.resolve() in [path.resolve() for path in paths]:
        raise ValueError(f"out: expected another file than the recordings, got {str(out)!r}")
    if out is not None and not out.parent.is_dir():
        raise ValueError(f"out: expected a file in a directory that exists, got {str(out)!r}")
    if out is None and len(paths) == 1 and paths[0].suffix.lower() == ".html":
        page.flight_in(paths[0])  # an error if it is another page
        out = paths[0]
    else:
        out = paths[0].with_name(f"{'-'.join(path.stem for path in paths)}.view.html") if out is None else out
        progress = ProgressLine()
        flights = []
        for path in paths:
            if progress.is_due:
                progress.show(f"{path}, {progress.seconds:.0f} s")
            flights.append(page.flight_in(path))
        page.write(out, flights, [path.stem.encode(errors="replace").decode() for path in paths])
        progress.clear()
        worlds = [", ".join(sorted(page.worlds_of(each))) for each in flights]
        if len(set(worlds)) > 1:
            print(f"flockstep view: the flights are in different worlds: {' and '.join(worlds)}"[:200], file=sys.stderr)
    print(out, flush=True)
    if page.has_display():
        webbrowser.open(out.resolve().as_uri())
