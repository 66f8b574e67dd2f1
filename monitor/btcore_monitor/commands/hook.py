"""`btcore hook`: breakpoints and injected statuses in a running robot, from the terminal."""

import contextlib
import sys
import threading
import time
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Final, NamedTuple

import click

from btcore.field_options import add_options, pass_options
from btcore.signals import EndingSignals
from btcore.suggestions import did_you_mean
from btcore_monitor.client_options import KeyOptions, WatchOptions
from btcore_monitor.console import print_line
from btcore_monitor.environment_checks import check_installed
from btcore_monitor.wire.groot2 import DEFAULT_ADDRESS

if TYPE_CHECKING:
    from btcore_monitor.breakpoints import BreakpointClient, HookReached
    from btcore_monitor.keys import ClientKeys

_CHECK_INTERVAL_S: Final = 0.1
"""Time (s) between two checks whether to stop."""

_TIMEOUT_NOTICE: Final = (
    "the robot disables its hooks after 5 s without a further command that sets or releases hooks"
)


class HookGroup(click.Group):
    """A command group with an optional ADDRESS, port 1667 of this machine by default."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, and insert the default address if a command is in its place."""
        options, rest = self._take_options(args)
        more, after = self._take_options(rest[1:])  # options may follow the address, too
        args = [*options, *more, *rest[:1], *after]
        # The index of the first argument after the options and their values.
        at = len(options) + len(more)
        if len(args) == at + 1 and args[at].isalpha() and args[at] not in self.commands:
            hint = did_you_mean(args[at], self.commands)
            if hint:
                raise click.UsageError(f"there is no command '{args[at]}'{hint}", ctx)
        if args[at : at + 1] and args[at] in self.commands:
            args = [*args[:at], DEFAULT_ADDRESS, *args[at:]]
        return super().parse_args(ctx, args)

    def _take_options(self, args: list[str]) -> tuple[list[str], list[str]]:
        """Split *args* after the options of the group, which all have values, at its beginning."""
        names = {name for option in self.params for name in option.opts}
        at = 0
        while at < len(args) and args[at].partition("=")[0] in names:
            at += 1 if "=" in args[at] else 2
        return args[:at], args[at:]


class _Connection(NamedTuple):
    address: str
    wait_s: float
    keys: "ClientKeys | None"


@click.group(cls=HookGroup, subcommand_metavar="COMMAND ...")
@click.argument("address", metavar="[ADDRESS]")
@click.option(
    "--wait",
    "wait_s",
    type=click.FloatRange(min=0.05),
    default=3.0,
    show_default=True,
    metavar="SECONDS",
    help="How long to wait for the robot.",
)
@pass_options(KeyOptions, "keys")
@click.pass_context
def hook(context: click.Context, address: str, wait_s: float, keys: KeyOptions) -> None:
    """Set breakpoints, step, and inject statuses in the tree at ADDRESS, on a robot with Groot 2's protocol.

    ADDRESS is as for `btcore monitor` (default: tcp://127.0.0.1:1667). A btcore robot has to be started with
    --allow-control. A PATTERN is a node's path or name, with the wildcards * ? [] for several nodes.
    """
    context.obj = _Connection(address, wait_s, *keys.read())


@contextlib.contextmanager
def _connect_robot() -> Iterator["BreakpointClient"]:
    """Connect to the robot at the command line's ADDRESS."""
    check_installed("zmq", "msgpack", "lxml")
    from btcore_monitor.breakpoints import BreakpointClient

    connection = click.get_current_context().find_object(_Connection)
    assert connection is not None
    with BreakpointClient(*connection) as robot:
        yield robot


_after = click.option("--after", is_flag=True, help="After the node's tick instead of before.")
_duration = add_options(WatchOptions, "duration")
_within = click.option(
    "--within",
    type=click.FloatRange(min=0),
    default=5.0,
    show_default=True,
    metavar="SECONDS",
    help="How long to wait for the next tick.",
)
_status = click.Choice(["SUCCESS", "FAILURE"], case_sensitive=False)


@hook.command("break")
@click.argument("patterns", nargs=-1, required=True, metavar="PATTERN...")
@_after
@click.option("--once", is_flag=True, help="Remove each breakpoint when it is released; stop after the last.")
@click.option("--leave", is_flag=True, help="Set them and exit; they last 5 s without further commands.")
@_duration
def break_(patterns: tuple[str, ...], after: bool, once: bool, leave: bool, duration: float | None) -> None:
    """Set breakpoints, print each breakpoint that is reached, and clear them at the end (Ctrl-C).

    From another terminal, `btcore hook release` lets the tree continue.
    """
    with _connect_robot() as robot:
        paths = robot.break_at(*patterns, after=after, once=once)
        for path in paths:
            print_line(f"breakpoint {'after' if after else 'before'} {path}")
        _warn_of_other_hooks(robot, paths)
        if leave:
            print_line(_TIMEOUT_NOTICE, err=True)
            return
        _print_reached(robot, duration, until_removed=paths if once else ())
        _clear(robot, paths)


@hook.command()
@click.argument("pattern", default="*")
@click.option(
    "--status", type=_status, metavar="STATUS", help="Status of the node, instead of the result of its tick."
)
@click.option("--remove", is_flag=True, help="Remove the breakpoint too.")
def release(pattern: str, status: str | None, remove: bool) -> None:
    """Let a tree that waits at a breakpoint continue."""
    with _connect_robot() as robot:
        for path in robot.release(pattern, status, remove):
            print_line(f"released {path}")


@hook.command()
@click.argument("count", type=click.IntRange(min=1), required=False)
@_within
def step(count: int | None, within: float) -> None:
    """Stop the tree before its root, and run a single tick (or COUNT ticks).

    At a terminal, without COUNT, each Enter is one tick, and q lets the tree run.
    """
    with _connect_robot() as robot:
        _warn_of_other_hooks(robot, [robot.tree.root.path])
        if count is not None or not sys.stdin.isatty():
            _print_step(robot, robot.step(count or 1, within))
            print_line(_TIMEOUT_NOTICE, err=True)
            return
        _print_step(robot, robot.step(0, within))
        print_line("Enter: one tick · q: let it run", err=True)
        try:
            while sys.stdin.readline().strip().lower() not in ("q", "quit"):
                _print_step(robot, robot.step(1, within))
        except KeyboardInterrupt:
            print_line(err=True)
        finally:
            _clear(robot, [robot.tree.root.path])


@hook.command()
@click.argument("pattern")
@click.argument("status", type=_status, metavar="STATUS")
@_after
@click.option("--keep", is_flag=True, help="Every tick, until Ctrl-C, instead of only the next tick.")
@_within
@_duration
def inject(pattern: str, status: str, after: bool, keep: bool, within: float, duration: float | None) -> None:
    """Let the next tick of the nodes that match PATTERN end with STATUS (SUCCESS or FAILURE)."""
    with _connect_robot() as robot:
        paths = robot.inject(pattern, status, after=after, once=not keep)
        _warn_of_other_hooks(robot, paths)
        if keep:
            for path in paths:
                print_line(f"{path}: always {status}")
            _print_reached(robot, duration)
            _clear(robot, paths)
            return
        # An injected status may be used at any later tick, so it is removed after the timeout.
        waiting, deadline = set(paths), time.monotonic() + within
        while waiting:
            reached = robot.poll(max(0.0, deadline - time.monotonic()))
            if reached is None or time.monotonic() > deadline:
                _clear(robot, sorted(waiting))
                late = ", ".join(sorted(waiting))
                raise click.ClickException(
                    f"{late}: not ticked within {within:g} s, so nothing was injected there"
                )
            if reached.path in waiting:
                waiting.remove(reached.path)
                print_line(f"{reached.path}: {status}")


@hook.command("list")
def list_() -> None:
    """List the robot's hooks, also those of other clients."""
    from btcore_monitor.wire.hooks import describe_hook

    with _connect_robot() as robot:
        lines = [describe_hook(hook, robot.path_of(hook.uid)) for hook in robot.hooks()]
        for line in lines or ["no hooks"]:
            print_line(line)


@hook.command()
@click.argument("pattern", default="*")
@click.option("--disable", is_flag=True, help="Disable all hooks instead of removing them.")
def clear(pattern: str, disable: bool) -> None:
    """Remove hooks (default: all); a tree that waits at a removed breakpoint continues."""
    with _connect_robot() as robot:
        if disable:
            robot.disable()
            print_line("all hooks are disabled")
            return
        paths = robot.clear(pattern)
        for line in [f"cleared {path}" for path in paths] or ["no hooks"]:
            print_line(line)


def _warn_of_other_hooks(robot: "BreakpointClient", own_paths: Collection[str]) -> None:
    """Print a warning if the robot has hooks at other nodes than *own_paths*."""
    from btcore_monitor.watch.hooks_warning import hooks_warning

    others = [hook for hook in robot.hooks() if robot.path_of(hook.uid) not in own_paths]
    if others:
        print_line(hooks_warning(others, robot.path_of, robot.address), err=True)


def _print_step(robot: "BreakpointClient", reached: "HookReached") -> None:
    statuses = robot.statuses()
    nodes = robot.tree.by_uid
    running = [
        node.path
        for node in nodes.values()
        if statuses.get(node.path) == "RUNNING"
        and not any(statuses.get(nodes[child].path) == "RUNNING" for child in node.children)
    ]
    where = "before the next tick" if reached.uid == robot.tree.root.uid else f"at {reached.path}"
    print_line(f"stopped {where}; running: {', '.join(running) or 'nothing'}")


def _print_reached(
    robot: "BreakpointClient", duration: float | None, until_removed: Collection[str] = ()
) -> None:
    """Print the hooks that are reached, until a signal or for *duration* s.

    If *until_removed* has paths, also stop when the nodes at these paths have no more hooks.
    """
    stop = threading.Event()
    deadline = None if duration is None else time.monotonic() + duration
    with EndingSignals(stop.set):
        while not stop.is_set() and (deadline is None or time.monotonic() < deadline):
            reached = robot.poll(_CHECK_INTERVAL_S)
            if reached is not None:
                print_line(f"reached {reached.path}")
            elif until_removed and not any(
                robot.path_of(hook.uid) in until_removed for hook in robot.hooks()
            ):
                return


def _clear(robot: "BreakpointClient", paths: list[str]) -> None:
    """Remove the hooks at *paths*; hooks that no longer exist are ignored."""
    from btcore_monitor.breakpoints import BreakpointError

    for path in paths:
        with contextlib.suppress(BreakpointError):
            robot.clear(path)
