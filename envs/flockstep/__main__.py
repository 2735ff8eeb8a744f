"""The command ``flockstep``, or ``python -m flockstep``."""

from __future__ import annotations

import argparse
import os
import pkgutil
import sys

from flockstep import headers

#: By name, the function that describes a command's arguments and sets its ``run``, and what the command does. A module
#: is imported only when its command is asked for.
_COMMANDS = {
    "doctor": (
        "doctor:add_arguments",
        "report which parts of flockstep work on this machine, what is missing, and how to install it",
    ),
    "check": (
        "testing.command:add_arguments",
        "check a task of yours: the rules of Gymnasium, what random actions and zeros earn, and its speed",
    ),
    "train": (
        "trainings.command:add_train",
        "train a policy by a row of the table of trainings, save it, and evaluate it",
    ),
    "evaluate": (
        "trainings.command:add_evaluate",
        "evaluate a policy, or a flyer without one, in flights that no training uses",
    ),
    "record": (
        "trainings.command:add_record",
        "film a flight of a policy that no training uses, or write a page or a file for view",
    ),
    "view": (
        "viewer.command:add_arguments",
        "show a recorded flight in a browser, or two in one view",
    ),
    "fly": (
        "viewer.fly:add_arguments",
        "fly a drone by keys or a gamepad, in a browser",
    ),
    "serve": (
        "serving:add_arguments",
        "let other programs, in C++, Python or any language with WebSockets, see and steer the drones of a simulation",
    ),
    "ardupilot": (
        "bridges.ardupilot:add_arguments",
        "let ArduPilot fly drones, by its JSON interface over UDP",
    ),
    "mcap": (
        "bridges.mcap:add_arguments",
        "fly an environment, or connect to a server, and record an MCAP file with ROS 2 messages",
    ),
    "identify": (
        "identification.command:add_arguments",
        "fit a drone file to flight logs: thrust, motor lag, inertia, rotor torque and drag, with their intervals",
    ),
}


class _PrintCmakeDir(argparse.Action):
    """Prints the folder on one line of any length, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(headers.cmake_dir())
        parser.exit()


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="flockstep", description="A batched drone simulator.")
    where = "print the folder for CMake's -Dflockstep_DIR, to build a task in C++, and exit"
    parser.add_argument("--cmake-dir", action=_PrintCmakeDir, nargs=0, help=where)
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND", dest="command")
    for name, (function, about) in _COMMANDS.items():
        command = commands.add_parser(name, help=about, description=about)
        if name in sys.argv:
            pkgutil.resolve_name(f"flockstep.{function}")(command)
    arguments = parser.parse_args()
    try:
        arguments.run(arguments)
        sys.stdout.flush()
    except OSError as error:
        if error.filename is not None or error.errno is None:  # one of ours has no number
            sys.exit(f"flockstep {arguments.command}: {error}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python would write the rest when it ends
        sys.exit(f"flockstep: cannot write the output: {error}")
    except (ValueError, TypeError, RuntimeError, ModuleNotFoundError) as error:  # a line, not a traceback
        sys.exit(f"flockstep {arguments.command}: {error}")
    except KeyboardInterrupt:
        sys.exit(130)  # as a shell reports it


if __name__ == "__main__":
    main()
