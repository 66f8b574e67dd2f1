"""Running what is no tree in the world that other packages bring, watched and ended as a tree's run is.

A command of class `Run` has the options of all packages; `resources` gives it a robot by them, and `perform`
lets time pass, with a tree of one leaf that is RUNNING, so that the viewer and the recorder take part.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import click
from rich.text import Text

from btcore.cli import terminal
from btcore.cli.exit_codes import ExitCode
from btcore.cli.extension import (
    GatheredResources,
    gather_resources,
    merge_reports,
    notify_interrupted,
)
from btcore.cli.progress import print_figures
from btcore.cli.run import (
    Finite,
    RunCommand,
    clock_of,
    extensions_of,
)
from btcore.cli.run_report import END_REASON_TEXT
from btcore.cli.tick_loop import EndReason, TickLoop
from btcore.clock import NS_PER_S, Clock
from btcore.engine.leaf import StatefulAction
from btcore.loading.load import loads
from btcore.registry.registry import Registry
from btcore.status import Status

__all__ = ["Finite", "ProgramResult", "RunCommand", "print_result", "require_resources", "run_program"]

RATE = 10.0
"""How often (Hz) the work is looked at, and whoever watches it is told."""


class ProgramResult(NamedTuple):
    """How it ended: *ending*, the exit *code*, the time (s) it took, and what the extensions report."""

    ending: EndReason
    code: ExitCode
    seconds: float
    report: dict[str, object]


def require_resources(
    ctx: click.Context, settings: Mapping[str, Any], wanted: Sequence[type]
) -> GatheredResources:
    """What the packages have for *wanted*, say a robot, by the options of the command.

    Raises click.UsageError where one of them is had from nobody.
    """
    brought, missing = extensions_of(ctx)
    found = gather_resources(brought, {"rate": None, **settings}, wanted)
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
    """Let the world go on for *settings*' ``duration`` (s), or until Ctrl-C; then call *end*, in that world.

    It also ends when *goes_on*, asked ten times a second, says so.

    What is to happen meanwhile is on the robot's schedule. *name*, in CamelCase, is what whoever watches
    sees running; *shown* are further things to be drawn. *clock* is for programs that bring their own.
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
                notify_interrupted(gathered.extensions)
            end()
        finally:
            tree.halt()
    brought = merge_reports([one.report() for one in gathered.extensions])
    code = ExitCode.INTERRUPTED if ending == "interrupted" else ExitCode.SUCCESS
    return ProgramResult(ending, code, pace.elapsed / NS_PER_S, brought)


def print_result(name: str, done: ProgramResult, figures: Mapping[str, object]) -> None:
    """Say on stderr how what is called *name* ended: its *figures*, and what the extensions report."""
    took = f"{done.seconds:.1f} s{END_REASON_TEXT[done.ending]}"
    terminal.stderr_console().print(Text.assemble(("■ ", "dim"), (name, "bold"), "  ", took), soft_wrap=True)
    print_figures({**({name: figures} if figures else {}), **done.report})
