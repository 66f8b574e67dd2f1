"""`btcore replay`: show a log or a recording, as text or in the viewer, or run a recording again."""

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Final, Protocol

import click

from btcore.cli import terminal
from btcore.clock import NS_PER_S
from btcore.escaping import escape_controls
from btcore.exit_codes import ExitCode
from btcore.field_options import ExtensibleCommand
from btcore.input_files import read_error, read_file
from btcore.json_text import load_json
from btcore.logs import LoggedTransition, Recording, read_log
from btcore.logs.recording import format_transition
from btcore.registry.mock_nodes import LETTERS
from btcore.status import FAILURE, RUNNING, SUCCESS, Status
from btcore.suggestions import did_you_mean, join_names
from btcore_recorder.files import EXTENSIONS, TEXT, read_recording
from btcore_recorder.verification import Verification, verify
from btcore_recorder.what_if import Change, ChangedRun, SetEntry, SetResult, run_changed

_COLOURS: Final[dict[Status, str]] = {RUNNING: "yellow", SUCCESS: "green", FAILURE: "red"}


class LogViewer(Protocol):
    """The options of a package that shows logs, under the entry point group `btcore.replay`.

    The class is derived from `btcore.options.Options`: its fields are options of `btcore replay`.
    """

    @property
    def outputs(self) -> Sequence[str]:
        """The given options that show or write something."""

    def show(self, recording: Recording, window: range) -> None:
        """Show the transitions with an index in *window*; without *outputs* in a window on the screen.

        Raises:
            BtcoreError: They cannot be shown.
        """


@click.command(
    cls=ExtensibleCommand,
    group="btcore.replay",
    short_help="Show a log again, as text or in the viewer, or run a recording again.",
)
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
    "--verify",
    "verifies",
    is_flag=True,
    help=f"Run a recording (…{TEXT}) again in the engine, and compare each tick with what was recorded.",
)
@click.option(
    "--tree",
    "tree_file",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.xml",
    help="What if the tree had been this one: run it on what the leaves of a recording did.",
)
@click.option(
    "--result",
    "results",
    multiple=True,
    metavar="NODE=S@TICK",
    help="What if a leaf had returned S, F, R or K (SKIPPED) in this tick. Repeatable.",
)
@click.option(
    "--set",
    "entries",
    multiple=True,
    metavar="KEY=VALUE@TICK",
    help="What if an entry of the main tree had been set before this tick. Repeatable.",
)
@click.option(
    "--match",
    "matches",
    multiple=True,
    metavar="OLD=NEW",
    help="With --tree: the node OLD of the recorded tree is NEW in this tree. Repeatable.",
)
@click.option("--json", "as_json", is_flag=True, help="Of --verify and of changed runs: print a JSON object.")
@click.pass_context
def replay(
    ctx: click.Context,
    /,
    log: str,
    text: bool,
    node_patterns: Sequence[str],
    from_s: float | None,
    to_s: float | None,
    verifies: bool,
    tree_file: Path | None,
    results: Sequence[str],
    entries: Sequence[str],
    matches: Sequence[str],
    as_json: bool,
    **viewer_values: Any,
) -> int:
    """Show LOG: a .btlog, an SQLite log (.db3, .btdb; FILE.db3#2 for session 2), a bag (.mcap) or a .fbl.

    LOG may also be a recording (.btrec.txt or .mcap) of a run, which is run again. Without options it opens
    the viewer, where the time can be moved back and forth. --save, --serve-web and --screenshot need no
    display. Times are in seconds since the log began. A truncated file is shown up to its end.
    """
    assert isinstance(ctx.command, ExtensibleCommand)
    viewer: LogViewer | None = ctx.command.make_extension(viewer_values)
    outputs = () if viewer is None else viewer.outputs
    changes = {"--tree": tree_file, "--result": results, "--set": entries}
    modes = {"--verify": verifies, **changes, "--text": text, **dict.fromkeys(outputs[:1], True)}
    given = [name for name, value in modes.items() if value]
    if given and given[0] in changes:
        given = [given[0], *(name for name in given if name not in changes)]
    if len(given) > 1:
        raise click.UsageError(f"{given[0]} and {given[1]} exclude each other: choose one.")
    runs_again = bool(given) and given[0] in ("--verify", *changes)
    if as_json and not runs_again:
        raise click.UsageError("--json needs --verify; for a log, use btcore stats LOG --json.")
    if matches and tree_file is None:
        raise click.UsageError("--match needs --tree.")
    if node_patterns and not text:
        raise click.UsageError("--node selects lines, so it needs --text.")
    if from_s is not None and to_s is not None and from_s > to_s:
        raise click.UsageError(f"--from {from_s:g} is after --to {to_s:g}.")
    if runs_again:
        if not log.endswith(EXTENSIONS):
            raise click.UsageError(
                f"{log} is a log of statuses: {given[0]} needs a recording (…{TEXT}) of what the ticks "
                "depended on, as btcore run --record writes it."
            )
        outcome: Verification | ChangedRun
        if verifies:
            outcome = verify(Path(log))
            is_same = outcome.is_equal
        else:
            outcome = _run_changed(Path(log), tree_file, results, entries, matches)
            is_same = outcome.is_same
        if as_json:
            terminal.print_json(outcome.as_data())
        else:
            click.echo(escape_controls(str(outcome)))
        return ExitCode.SUCCESS if is_same else ExitCode.FAILURE
    recording = read_log(log)
    for warning in recording.warnings:
        terminal.print_warning(warning)
    window = _find_window(recording, from_s, to_s)
    if text:
        _print(recording, window, node_patterns)
    elif viewer is None:
        raise click.UsageError("there is no viewer: install the extra btcore[monitor], or use --text")
    else:
        viewer.show(recording, window)
    return ExitCode.SUCCESS


def _run_changed(
    log: Path, tree_file: Path | None, results: Sequence[str], entries: Sequence[str], matches: Sequence[str]
) -> ChangedRun:
    """Run a recording again with the changes that the options describe."""
    changes: list[Change] = []
    for text in results:
        node, letter, tick = _split(text, "--result")
        if letter not in LETTERS:
            raise click.UsageError(
                f"--result {text}: '{letter}' is not a result: use {join_names(LETTERS, 'or')}"
            )
        changes.append(SetResult(tick, node, LETTERS[letter]))
    for text in entries:
        key, value, tick = _split(text, "--set")
        try:
            decoded = load_json(value)
        except ValueError:
            decoded = value
        changes.append(SetEntry(tick, key, decoded))
    pairs = dict(_halves(text, "--match") for text in matches)
    document = None if tree_file is None else (str(tree_file), _read_tree(tree_file))
    return run_changed(read_recording(log), changes, document, pairs)


def _split(text: str, option: str) -> tuple[str, str, int]:
    """Return the parts of NAME=VALUE@TICK."""
    rest, _, tick = text.rpartition("@")
    name, value = _halves(rest, option) if rest else ("", "")
    if not (name and tick.isdecimal()):
        raise click.UsageError(f"{option} {text}: expected NAME=VALUE@TICK, such as door=F@12")
    return name, value, int(tick)


def _halves(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{option} {text}: '=' is missing")
    return name, value


def _read_tree(path: Path) -> str:
    try:
        return read_file(path).decode("utf-8-sig")
    except OSError as error:
        reason = read_error(error)
    except UnicodeDecodeError as error:
        reason = str(error)
    raise click.ClickException(f"--tree {path}: {reason}")


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
