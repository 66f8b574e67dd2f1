"""`btcore replay`: show a log or a recording, as text or in the viewer, or run a recording again."""

from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final, Protocol

import click

from btcore.cli import terminal
from btcore.clock import NS_PER_S
from btcore.escaping import escape_controls
from btcore.exit_codes import ExitCode
from btcore.field_options import ExtensibleCommand, pass_options
from btcore.logs import LoggedTransition, Recording, read_log
from btcore.logs.moments import Moment
from btcore.logs.recording import format_transition
from btcore.status import FAILURE, RUNNING, SUCCESS, Status
from btcore.suggestions import counted, did_you_mean
from btcore_recorder.commands.rerun import RerunOptions

_COLOURS: Final[dict[Status, str]] = {RUNNING: "yellow", SUCCESS: "green", FAILURE: "red"}


class LogViewer(Protocol):
    """The options of a package that shows logs, under the entry point group `btcore.replay`.

    The class is derived from `btcore.options.Options`: its fields are options of `btcore replay`.
    """

    @property
    def outputs(self) -> Sequence[str]:
        """The given options that show or write something."""

    def show(self, recording: Recording, window: range, moments: Iterable[Moment]) -> None:
        """Show the transitions with an index in *window*; without *outputs* in a window on the screen.

        A recording also has *moments*: the entries, and the inputs and outputs of leaves, after its ticks.

        Raises:
            BtcoreError: They cannot be shown.
        """


@click.command(cls=ExtensibleCommand, group="btcore.replay")
@click.argument("log", metavar="LOG")
@click.option("--text", is_flag=True, help="Print a line for each transition instead: time, path, old → new.")
@click.option(
    "--node",
    "node_patterns",
    multiple=True,
    metavar="PATTERN",
    help="With --text: only nodes whose path matches, such as 'Patrol/*'; may be given several times.",
)
@click.option(
    "--from",
    "from_s",
    type=float,
    metavar="SECONDS",
    help="Time of the first transition.  [default: the start]",
)
@click.option(
    "--to", "to_s", type=float, metavar="SECONDS", help="Time of the last transition.  [default: the end]"
)
@click.option(
    "--save-recording",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write LOG as a recording (.btrec.txt or .mcap) instead: a recording in its other form, or what the "
    "statuses of a log determine of its run.",
)
@pass_options(RerunOptions, "rerun")
@click.pass_context
def replay(
    ctx: click.Context,
    /,
    log: str,
    text: bool,
    node_patterns: Sequence[str],
    from_s: float | None,
    to_s: float | None,
    save_recording: Path | None,
    rerun: RerunOptions,
    **viewer_values: Any,
) -> int:
    """Show LOG: a .btlog, an SQLite log (.db3, .btdb; FILE.db3#2 for session 2), a bag (.mcap) or a .fbl.

    LOG may also be a recording (.btrec.txt or .mcap) of a run, which is run again; with --verify, --tree,
    --result and --set also a folder of recordings. Without options it opens the viewer, where the time can be
    moved back and forth. --save, --serve-web and --screenshot need no display. Times are in seconds since the
    log began. A truncated file is shown up to its end.
    """
    assert isinstance(ctx.command, ExtensibleCommand)
    viewer: LogViewer | None = ctx.command.create_extension(viewer_values)
    outputs = () if viewer is None else viewer.outputs
    own = {"--text": text, "--save-recording": save_recording is not None}
    modes = [*filter(None, [rerun.mode]), *(name for name, is_given in own.items() if is_given), *outputs[:1]]
    if len(modes) > 1:
        raise click.UsageError(f"{modes[0]} and {modes[1]} exclude each other: choose one.")
    if node_patterns and not text:
        raise click.UsageError("--node selects lines, so it needs --text.")
    if from_s is not None and to_s is not None and from_s > to_s:
        raise click.UsageError(f"--from {from_s:g} is after --to {to_s:g}.")
    if rerun.mode:
        return rerun.run(Path(log), from_s, to_s)
    recording = read_log(log)
    for warning in recording.warnings:
        terminal.print_warning(warning)
    if save_recording is not None:
        _save(recording, save_recording)
        return ExitCode.SUCCESS
    window = _find_window(recording, from_s, to_s)
    if text:
        _print(recording, window, node_patterns)
    elif viewer is None:
        raise click.UsageError("there is no viewer: install the extra btcore[monitor], or use --text")
    else:
        from btcore_recorder.replayed_log import ReplayedLog

        moments = recording.moments() if isinstance(recording, ReplayedLog) else ()
        viewer.show(recording, window, moments)
    return ExitCode.SUCCESS


def _save(log: Recording, file: Path) -> None:
    """Write a log as a recording to *file*."""
    from btcore_recorder.files import describe_reconstruction, save_recording
    from btcore_recorder.import_log import import_log
    from btcore_recorder.replayed_log import ReplayedLog

    run = log.run if isinstance(log, ReplayedLog) else import_log(log)
    save_recording(file, run)
    click.echo(f"{file}: {counted(sum(step.tick > 0 for step in run.steps), 'tick')} of {log.path}")
    if not isinstance(log, ReplayedLog):
        terminal.print_warning(f"{file}: {describe_reconstruction(run.head)}")


def _find_window(recording: Recording, from_s: float | None, to_s: float | None) -> range:
    """Return the indices of the transitions between *from_s* and *to_s* (s since the start, inclusive)."""
    since = [change.stamp - recording.start for change in recording.transitions]
    chosen = [
        index
        for index, ns in enumerate(since)
        if (from_s is None or ns >= from_s * NS_PER_S) and (to_s is None or ns <= to_s * NS_PER_S)
    ]
    if chosen:
        return range(chosen[0], chosen[-1] + 1)
    if not since:
        return range(0)
    length = since[-1] / NS_PER_S
    raise click.UsageError(
        f"{recording.path}: there are no transitions in this time range; the transitions are at "
        f"{since[0] / NS_PER_S:.3f} s to {length:.3f} s"
    )


def _print(recording: Recording, window: range, patterns: Sequence[str]) -> None:
    keys = recording.keys()
    for pattern in patterns:
        if not any(fnmatchcase(path, pattern) for path in keys.values()):
            hint = did_you_mean(pattern, keys.values())
            raise click.UsageError(f"--node: no node's path matches '{pattern}'{hint}")
    chosen = {
        uid: escape_controls(path, one_line=True)
        for uid, path in keys.items()
        if not patterns or any(fnmatchcase(path, pattern) for pattern in patterns)
    }
    width = max(map(len, chosen.values()), default=0)
    for item in transitions_and_gaps(recording, window):
        if isinstance(item, str):
            click.secho(f"{'—':>12}  {escape_controls(item, one_line=True)}", dim=True)
        elif item.uid in chosen:
            since = item.stamp - recording.start
            line = format_transition(since, chosen[item.uid], item.previous, item.status, width)
            colour = _COLOURS.get(item.status)
            click.secho(line, fg=colour, dim=colour is None or None)


def transitions_and_gaps(recording: Recording, window: range) -> Iterator[LoggedTransition | str]:
    """Yield the transitions with an index in *window*, and sentences where data is missing."""
    gaps = [gap for gap in recording.gaps if window.start <= gap.at <= window.stop]
    for index in window:
        while gaps and gaps[0].at <= index:
            yield f"gap: {gaps.pop(0).reason}"
        yield recording.transitions[index]
    yield from (f"gap: {gap.reason}" for gap in gaps)
    if recording.damage and window.stop == len(recording.transitions):
        yield recording.damage
