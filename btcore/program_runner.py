"""Running a program in the world that extensions provide: for commands of other packages.

A command of class :class:`RunCommand` has the options of all extensions. :func:`require_resources` returns
what they provide, say a robot. :func:`run_program` lets time pass, with a tree of a single leaf that is
RUNNING, so that the viewer and the recorder take part.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import click
from rich.text import Text

from btcore.cli import terminal
from btcore.cli.exit_codes import ExitCode
from btcore.cli.extension import GatheredResources, gather_resources, load_extensions, merge_reports
from btcore.cli.progress import print_figures
from btcore.cli.run import FiniteRange, RunCommand, clock_of
from btcore.cli.run_report import END_REASON_TEXT
from btcore.cli.tick_loop import EndReason, TickLoop
from btcore.clock import NS_PER_S, Clock
from btcore.engine.leaf import StatefulAction
from btcore.loading.load import loads
from btcore.registry.registry import Registry
from btcore.status import Status

__all__ = [
    "FiniteRange",
    "GatheredResources",
    "ProgramResult",
    "RunCommand",
    "print_result",
    "require_resources",
    "run_program",
]

RATE = 10.0
"""How often (Hz) the tree is ticked, and with it viewers are updated."""


class ProgramResult(NamedTuple):
    """How a program ended: the reason, the exit code, the duration (s), and the reports of the extensions."""

    ending: EndReason
    code: ExitCode
    seconds: float
    report: dict[str, object]


def require_resources(
    ctx: click.Context, settings: Mapping[str, Any], wanted: Sequence[type]
) -> GatheredResources:
    """Return what the extensions provide for *wanted*, say a robot.

    Args:
        ctx: The context of a command of class `RunCommand`.
        settings: The options of the command.
        wanted: The types of which there has to be a resource.

    Raises:
        click.UsageError: No extension provides a resource of one of the types.
        ExtensionError: An installed extension can't be used.
    """
    extensions, missing = load_extensions(ctx)
    found = gather_resources(extensions, {"rate": None, **settings}, wanted)
    for kind in wanted:
        if not any(isinstance(one, kind) for one in found.resources):
            why = "; ".join(f"'{one.name}' may, and isn't there: {one.remedy}" for one in missing)
            raise click.UsageError(f"no package brings a {kind.__name__}{': ' * bool(why)}{why}")
    return found


def run_program(
    name: str,
    gathered: GatheredResources,
    settings: Mapping[str, Any],
    end: Callable[[], None],
    *,
    clock: Clock | None = None,
    shown: Sequence[object] = (),
    goes_on: Callable[[], bool] = lambda: True,
) -> ProgramResult:
    """Let time pass in the world of *gathered* while the tasks on the robot's schedule run.

    Args:
        name: The ID, in CamelCase, that viewers show for the program.
        gathered: What `require_resources` returned.
        settings: The options of the command, among them ``duration`` (s, or None) and ``fast``.
        end: Called once at the end, while the world still exists.
        clock: The clock of a program without a world.
        shown: Further objects that viewers draw.
        goes_on: Called ten times a second; the program ends when it returns false.
    """

    class Work(StatefulAction):
        def on_start(self) -> Status:
            return self.on_running()

        def on_running(self) -> Status:
            return Status.RUNNING if goes_on() else Status.SUCCESS

    nodes = Registry.standard()
    nodes.add(Work, ID=name)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="{name}Alone"><{name}/></BehaviorTree></root>'
    things = [*gathered.resources, *shown]
    timing = clock if clock is not None else clock_of(things, settings["fast"])
    tree = loads(text, nodes=nodes, resources=things, clock=timing)
    pace = TickLoop(tree, RATE, settings["duration"], "done", lambda status: None, fast=settings["fast"])
    with ExitStack() as attached:
        for extension in gathered.extensions:
            attached.enter_context(extension.attach(tree, things, settings))
        try:
            with pace.signals():
                ending = pace.run()
            if ending == "interrupted":
                for extension in gathered.extensions:
                    extension.on_interrupt()
            end()
        finally:
            tree.halt()
    report = merge_reports(gathered.extensions)
    code = ExitCode.INTERRUPTED if ending == "interrupted" else ExitCode.SUCCESS
    return ProgramResult(ending, code, pace.elapsed / NS_PER_S, report)


def print_result(name: str, done: ProgramResult, figures: Mapping[str, object]) -> None:
    """Print the summary of the program *name* on stderr: its *figures*, and what the extensions report."""
    took = f"{done.seconds:.1f} s{END_REASON_TEXT[done.ending]}"
    terminal.stderr_console().print(Text.assemble(("■ ", "dim"), (name, "bold"), "  ", took), soft_wrap=True)
    print_figures({**({name: figures} if figures else {}), **done.report})
