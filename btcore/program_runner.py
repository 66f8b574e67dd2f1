"""Run a program without a behavior tree of its own, such as teleoperation, for other packages.

A command of class `RunCommand` has the options of all extensions. `require_resources` returns
the resources that the extensions provide, such as a robot. `run_program` advances the time of the
robot's world until the program ends. Meanwhile it ticks a tree of a single leaf that stays RUNNING, so that
the viewer and the recorder work as in `btcore run`.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from types import FrameType
from typing import Any, NamedTuple

import click
from rich.text import Text

from btcore.cli import terminal
from btcore.cli.commands.run import FiniteRange, choose_clock
from btcore.cli.exit_codes import ExitCode, code_of_signal
from btcore.cli.extension import GatheredResources, gather_resources, load_extensions, merge_reports
from btcore.cli.extension_options import RunCommand, warn_unused_options
from btcore.cli.node_libraries import load_libraries
from btcore.cli.run_report import END_REASON_TEXT, print_reports
from btcore.cli.terminal import print_json
from btcore.cli.tick_loop import EndReason, TickLoop, ending_signals, signal_handlers
from btcore.clock import NS_PER_S, Clock
from btcore.engine.leaf import StatefulAction
from btcore.entry_points import names_by_remedy
from btcore.loading.load import loads
from btcore.registry.registry import Registry
from btcore.run_extension import OutputError
from btcore.status import Status

__all__ = [
    "FiniteRange",
    "GatheredResources",
    "ProgramResult",
    "RunCommand",
    "load_nodes",
    "print_json",
    "print_result",
    "provide_resources",
    "require_resources",
    "run_program",
    "run_server",
]

RATE = 10.0
"""The rate (Hz) at which the tree is ticked, and viewers are updated."""


class ProgramResult(NamedTuple):
    """The result of a program.

    Attributes:
        end_reason: The reason why the program ended.
        code: The exit code.
        seconds: The duration (s) by the world's clock.
        report: The reports of the extensions.
    """

    end_reason: EndReason
    code: ExitCode
    seconds: float
    report: dict[str, object]


def load_nodes(plugins: Sequence[str]) -> Registry:
    """Return the nodes of the installed libraries and of *plugins*.

    Args:
        plugins: Modules and Python files, the values of the option `--plugin`.

    Raises:
        RegistrationError: A plugin cannot be loaded.
        click.UsageError: A plugin is given twice.
    """
    return load_libraries(plugins).nodes


def provide_resources(
    ctx: click.Context, settings: Mapping[str, Any], wanted: Sequence[type]
) -> GatheredResources:
    """Return the resources that the extensions provide for *wanted*; a type may remain without a resource.

    Args:
        ctx: The context of a command of class `RunCommand`.
        settings: The options of the command.
        wanted: The types of the resources.

    Raises:
        click.UsageError: An option has an invalid value.
        ExtensionError: An installed extension cannot be used.
    """
    return gather_resources(load_extensions(ctx).extensions, {"rate": None, **settings}, wanted)


def require_resources(
    ctx: click.Context,
    settings: Mapping[str, Any],
    wanted: Sequence[type],
    optional: Sequence[type] = (),
    used: Sequence[str] = (),
) -> GatheredResources:
    """Return the resources that the extensions provide for *wanted*, such as a robot.

    Args:
        ctx: The context of a command of class `RunCommand`.
        settings: The options of the command.
        wanted: The types of the required resources.
        optional: The types of further resources, which the result contains if an extension provides them.
        used: The options of extensions that the command itself uses, such as "--ros-args".

    Raises:
        click.UsageError: No extension provides a resource of one of the types.
        ExtensionError: An installed extension cannot be used.
    """
    gathered = provide_resources(ctx, settings, (*wanted, *optional))
    warn_unused_options(ctx, gathered.without_resources, "this command", used)
    unavailable = load_extensions(ctx).unavailable
    for kind in wanted:
        if not any(isinstance(resource, kind) for resource in gathered.resources):
            unloaded = "".join(
                f"; extensions that may provide it cannot be loaded ({names}): {remedy}"
                for remedy, names in names_by_remedy(unavailable).items()
            )
            raise click.UsageError(f"no extension provides a {kind.__name__}{unloaded}")
    return gathered


def run_program(
    name: str,
    gathered: GatheredResources,
    settings: Mapping[str, Any],
    on_end: Callable[[], None],
    *,
    clock: Clock | None = None,
    extra_resources: Sequence[object] = (),
    keep_running: Callable[[], bool] = lambda: True,
) -> ProgramResult:
    """Run a program: advance the world's time until *keep_running* returns False or the duration has passed.

    The work of the program is done in *keep_running*, or in tasks that were added to the robot's schedule.

    Args:
        name: The ID, in CamelCase, that viewers show for the program.
        gathered: The result of `require_resources`.
        settings: The options of the command, including `duration` (s, or None) and `fast`.
        on_end: Called once at the end, while the world still exists.
        clock: The clock of a program without a world; by default the clock of the resources.
        extra_resources: Further resources, such as objects that viewers draw.
        keep_running: Called ten times a second of the clock; the program ends when it returns False.
    """

    class Work(StatefulAction):
        def on_start(self) -> Status:
            return self.on_running()

        def on_running(self) -> Status:
            return Status.RUNNING if keep_running() else Status.SUCCESS

    nodes = Registry.standard()
    nodes.add(Work, ID=name)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="{name}Alone"><{name}/></BehaviorTree></root>'
    resources = [*gathered.resources, *extra_resources]
    clock = clock if clock is not None else choose_clock(resources, settings["fast"])
    tree = loads(text, nodes=nodes, resources=resources, clock=clock)
    loop = TickLoop(tree, RATE, settings["duration"], "done", lambda status: None, fast=settings["fast"])
    end_reason: EndReason = "done"
    is_complete = True
    try:
        with ExitStack() as attached:
            for extension in gathered.extensions:
                attached.enter_context(extension.attach(tree, resources, settings))
            try:
                with loop.handle_signals():
                    end_reason = loop.run()
                if end_reason == "interrupted":
                    for extension in gathered.extensions:
                        extension.on_interrupt()
                on_end()
            finally:
                tree.halt()
    except OutputError as error:
        is_complete = False
        terminal.print_error(str(error))
    report = merge_reports(gathered.extensions)
    code = code_of_signal(loop.received_signal) if end_reason == "interrupted" else ExitCode.SUCCESS
    if not is_complete:
        code = ExitCode.INCOMPLETE_OUTPUT
    return ProgramResult(end_reason, code, loop.elapsed_ns / NS_PER_S, report)


def run_server(
    gathered: GatheredResources,
    settings: Mapping[str, Any],
    resources: Sequence[object],
    run: Callable[[], None],
    stop: Callable[[], None],
) -> ExitCode:
    """Run a server that creates a tree for each request, until a signal ends it.

    Before the first request, viewers show a tree that waits. The server passes each of its trees to
    `RunExtension.replace_tree` of the extensions in *gathered*.

    Args:
        gathered: The result of `provide_resources`.
        settings: The options of the command.
        resources: The resources of the trees.
        run: Called once; serves until *stop* was called.
        stop: Called by the handler of SIGINT, SIGTERM or SIGHUP. A second signal raises KeyboardInterrupt.

    Returns:
        The exit code.
    """
    text = '<root BTCPP_format="4"><BehaviorTree ID="Waiting"><AlwaysSuccess/></BehaviorTree></root>'
    received: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        if received:
            raise KeyboardInterrupt
        received.append(number)
        stop()

    is_complete = True
    try:
        with ExitStack() as attached:
            tree = loads(text)
            for extension in gathered.extensions:
                attached.enter_context(extension.attach(tree, resources, settings))
            with signal_handlers(ending_signals(), end):
                run()
            for extension in gathered.extensions:
                extension.on_interrupt()
    except OutputError as error:
        is_complete = False
        terminal.print_error(str(error))
    if not is_complete:
        return ExitCode.INCOMPLETE_OUTPUT
    return code_of_signal(received[0]) if received else ExitCode.SUCCESS


def print_result(name: str, result: ProgramResult, own_report: Mapping[str, object]) -> None:
    """Print the summary of a program on stderr.

    Args:
        name: The name of the program.
        result: The result of `run_program`, with the reports of the extensions.
        own_report: The program's own report.
    """
    took = f"{result.seconds:.1f} s{END_REASON_TEXT[result.end_reason]}"
    terminal.stderr_console().print(Text.assemble(("■ ", "dim"), (name, "bold"), "  ", took), soft_wrap=True)
    print_reports({**({name: own_report} if own_report else {}), **result.report})
