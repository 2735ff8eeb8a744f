"""The command ``python -m flockstep``."""

from __future__ import annotations

import argparse
import os
import sys

from flockstep import doctor, headers, serving
from flockstep.bridges import ardupilot, mcap
from flockstep.identification import command as identification
from flockstep.trainings import command as trainings
from flockstep.viewer import fly


class _PrintCmakeDir(argparse.Action):
    """Prints the folder on one line of any length, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(headers.cmake_dir())
        parser.exit()


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m flockstep", description="A batched drone simulator.")
    where = "print the folder for CMake's -Dflockstep_DIR, to build a task in C++, and exit"
    parser.add_argument("--cmake-dir", action=_PrintCmakeDir, nargs=0, help=where)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    about = "report which parts of flockstep work on this machine, what is missing, and how to install it"
    commands.add_parser("doctor", help=about, description=about).set_defaults(run=lambda _: doctor.main())
    trainings.add_commands(commands)
    serving.add_command(commands)
    ardupilot.add_command(commands)
    mcap.add_command(commands)
    identification.add_command(commands)
    fly.add_command(commands)
    arguments = parser.parse_args()
    try:
        arguments.run(arguments)
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python would write the rest when it ends
        sys.exit(f"flockstep: cannot write the output: {error}" if error.filename is None else f"flockstep: {error}")


if __name__ == "__main__":
    main()
