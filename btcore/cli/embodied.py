"""Running what is no tree in the world that other packages bring, watched and ended as a tree's run is.

A command of class `Run` has the options of all packages; `resources` gives it a robot by them, and `perform`
lets time pass, with a tree of one leaf that is RUNNING, so that the viewer and the recorder take part.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import click
from rich.text import Text

from btcore.cli import paint
from btcore.cli.exit_codes import INTERRUPTED
from btcore.cli.outcome import HOW
from btcore.cli.pace import Ending, Pace
from btcore.cli.progress import report
from btcore.cli.resources import Gathered, gather, joined, tell_interrupted
from btcore.cli.run import Finite, Run, clock_of, extensions_of
from btcore.clock import NS_PER_S, Clock
from btcore.leaf import StatefulAction
from btcore.loading import loads
from btcore.registry import Registry
from btcore.status import Status

__all__ = ["Finite", "Performed", "Run", "conclude", "perform", "resources"]

RATE = 10.0
"""How often (Hz) the work is looked at, and whoever watches it is told."""


class Performed(NamedTuple):
    """How it ended: *ending*, the exit *code*, the time (s) it took, and what the extensions report."""

    ending: Ending
    code: int
    seconds: float
    report: dict[str, object]


def resources(ctx: click.Context, settings: Mapping[str, Any], wanted: Sequence[type]) -> Gathered:
    """What the packages have for *wanted*, say a robot, by the options of the command.

    Raises click.UsageError where one of them is had from nobody.
    """
    brought, missing = extensions_of(ctx)
    found = gather(brought, {"rate": None, **settings}, wanted)
    for kind in wanted:
        if not any(isinstance(one, kind) for one in found.resources):
            why = "; ".join(f"'{one.name}' may, and isn't there: {one.remedy}" for one in missing)
            raise click.UsageError(f"no package brings a {kind.__name__}{': ' * bool(why)}{why}")
    return found


def perform(
    name: str,
    gathered: Gathered,
    settings: Mapping[str, Any],
    end: Callable[[], None],
    *,
    clock: Clock | None = None,
    shown: Sequence[object] = (),
    goes_on: Callable[[], bool] = lambda: True,
) -> Performed:
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
    pace = Pace(tree, RATE, settings["duration"], "done", lambda status: None, fast=settings["fast"])
    with ExitStack() as attached:
        for extension in gathered.brought:
            attached.enter_context(extension.attach(tree, things, settings))
        try:
            with pace.signals():
                ending = pace.run()
            if ending == "interrupted":
                tell_interrupted(gathered.brought)
            end()
        finally:
            tree.halt()
    brought = joined([one.report() for one in gathered.brought])
    code = INTERRUPTED if ending == "interrupted" else 0
    return Performed(ending, code, pace.elapsed / NS_PER_S, brought)


def conclude(name: str, done: Performed, figures: Mapping[str, object]) -> None:
    """Say on stderr how what is called *name* ended: its *figures*, and what the extensions report."""
    took = f"{done.seconds:.1f} s{HOW[done.ending]}"
    paint.errors().print(Text.assemble(("■ ", "dim"), (name, "bold"), "  ", took), soft_wrap=True)
    report({**({name: figures} if figures else {}), **done.report})
