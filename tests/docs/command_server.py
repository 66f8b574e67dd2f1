"""Runs commands of btcore, each in a fork of this process, because imports take most of a command's time.

Each line of stdin is a JSON array: the folder, the output file and the arguments. The reply is the exit code.
"""

import importlib
import json
import os
import runpy
import sys

# What commands import, and what `btcore run` imports only with a robot.
MODULES = (
    "btcore_studio.convert.command",
    "btcore.cli.main",
    "btcore_proof.command",
    "btcore.cli.commands.run",
    "btcore_drawing.command",
    "btcore.cli.commands.validate",
    "btcore_monitor.providers",
    "btcore_robot.book.commands",
    "btcore_navigation.leaves",
    "btcore_robot.leaves",
    "btcore_navigation.nodes.actions",
    "btcore_navigation.stack",
    "btcore_sim.providers",
    "btcore_sim.run_metrics",
    "btcore_sim.simulated_robot",
)


def import_modules() -> None:
    """Import MODULES, except those whose packages need something that is not installed."""
    for name in MODULES:
        try:
            importlib.import_module(name)
        except ModuleNotFoundError as error:
            if str(error.name).startswith("btcore"):
                raise


def run_command(folder: str, output: str, *arguments: str) -> None:
    """Do what `python -m btcore` does, in this process."""
    os.chdir(folder)
    opened = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(opened, 1)
    os.dup2(opened, 2)
    sys.path[0] = folder
    sys.argv = ["btcore", *arguments]
    runpy.run_module("btcore", run_name="__main__", alter_sys=True)


def main() -> None:
    import_modules()
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            run_command(*json.loads(line))
            return
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    main()
