"""`btcore mcp`: serve AI agents that write or examine trees."""

import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import click

from btcore.exit_codes import code_of_signal
from btcore.field_options import FiniteRange


@click.command()
@click.argument("folder", default=".", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--plugin",
    "plugins",
    multiple=True,
    metavar="MODULE|FILE.py",
    help="Load a node library in each call: its code runs on this machine. Without this option, agents can "
    "use btcore's own nodes, and nodes that are declared by models. Repeatable.",
)
@click.option(
    "--time-limit",
    type=FiniteRange(1, 3600),
    default=60.0,
    show_default=True,
    metavar="S",
    help="Stop a call after S seconds.",
)
@click.option(
    "--log",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Append a line of JSON for each request to FILE instead of printing it on stderr.",
)
def mcp(folder: Path, plugins: Sequence[str], time_limit: float, log: Path | None) -> None:
    """Serve AI agents that write or examine the trees in FOLDER, over stdin and stdout.

    The protocol is the Model Context Protocol. Agents can list nodes, check, draw, prove and simulate trees,
    and read logs. FOLDER is the working directory by default; tools accept no path outside of it. Trees run
    in simulated time, and there is no way to a real robot. Leaves, and the code of plugins, have your rights.
    """
    # The extra is imported only here, so that --help works without it.
    import anyio

    from btcore_studio.agents.command_process import CommandRunner
    from btcore_studio.agents.server import serve_stdio
    from btcore_studio.served_folder import ServedFolder

    with ExitStack() as opened:
        file = sys.stderr
        if log is not None:
            try:
                file = opened.enter_context(log.open("a", encoding="utf-8", newline="\n"))
            except OSError as error:
                raise click.ClickException(f"cannot write {log}: {error.strerror}") from error
        served = ServedFolder(folder)
        runner = CommandRunner(served, time_limit, plugins)
        opened.callback(runner.close)
        number = anyio.run(serve_stdio, served, runner, file)
    if number:
        os._exit(code_of_signal(number))  # Python would wait for the thread that waits for stdin
