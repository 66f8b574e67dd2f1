"""`btcore record`: connect to a running robot and write its data into files."""

import contextlib
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from btcore.exit_codes import ExitCode
from btcore.field_options import pass_options
from btcore.signals import EndingSignals
from btcore.suggestions import join_names, suggestion
from btcore_monitor.client_options import WatchOptions
from btcore_monitor.commands.notices import format_notice
from btcore_monitor.console import print_line
from btcore_monitor.environment_checks import check_installed, check_writable
from btcore_monitor.errors import RecordingError
from btcore_monitor.events import ConnectionEvent, Event, TreeEvent
from btcore_monitor.process_end import abandon, abandon_if_late
from btcore_monitor.viewer_options import DrawingOptions
from btcore_monitor.wire.groot2 import DEFAULT_ADDRESS

if TYPE_CHECKING:
    from btcore_monitor.screen.robot_view import RobotView
    from btcore_monitor.screen.sinks import RecordingSinks
    from btcore_monitor.watch.feed import Feed

_RERUN: Final = ".rrd"
_BAG: Final = ".mcap"
_STATUSES_ONLY: Final = "logs hold statuses; blackboards, exceptions, ticks and the scene need -o FILE.rrd"


@click.command()
@click.argument("address", default=DEFAULT_ADDRESS)
@click.option(
    "-o",
    "--output",
    "outputs",
    type=click.Path(dir_okay=False, path_type=Path),
    multiple=True,
    metavar="FILE",
    help="Output file: .btlog (Groot 2), .db3 or .btdb (SQLite), .mcap (ROS 2), .rrd (rerun). Repeatable.",
)
@click.option(
    "--bag",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.mcap",
    help="Write a bag of ROS 2 with behavior_tree_log; the same as -o FILE.mcap.",
)
@pass_options(WatchOptions, "watch")
@pass_options(DrawingOptions, "drawing")
def record(
    address: str,
    outputs: Sequence[Path],
    bag: Path | None,
    watch: WatchOptions,
    drawing: DrawingOptions,
) -> None:
    """Record the tree at ADDRESS, on any robot that btcore monitor can show.

    ADDRESS is tcp://HOST:PORT, HOST:PORT, HOST or PORT (default: tcp://127.0.0.1:1667). The robot may start
    later, stop, and restart: another tree gets its own files, run.2.btlog after run.btlog. Ctrl-C stops and
    completes the files. Gaps are marked in the files, and counted at the end.
    """
    if bag is not None:
        if bag.suffix != _BAG:
            raise click.UsageError(f"--bag {bag}: a bag ends in {_BAG}; {suggestion(bag.with_suffix(_BAG))}")
        outputs = (*outputs, bag)
    if not outputs:
        raise click.UsageError("Missing option '-o' / '--output' or '--bag'.")
    check_installed("zmq", "msgpack", *(["rerun", "numpy"] if _filter_recordings(outputs) else []))
    from btcore_monitor.log_writer import LOGS, WRITE_ERRORS

    _check(outputs, (*LOGS, _RERUN))
    [keys] = watch.read()
    try:
        with (
            abandon_if_late(watch.duration),
            watch.create_feed(address, keys) as feed,
        ):
            files = _Files(outputs, drawing)
            try:
                _follow(feed, files, watch)
            finally:
                files.close()
    except RecordingError as error:
        abandon(error)
    except WRITE_ERRORS as error:
        print_line(f"error: the recording ends here, because writing failed: {error}", err=True)
        click.get_current_context().exit(ExitCode.INCOMPLETE_OUTPUT)
    if not files.written:
        raise click.ClickException(f"no tree was seen at {address}, so nothing is recorded")
    log = files.log
    gaps = "1 gap is" if log.gaps == 1 else f"{log.gaps} gaps are"
    lost = f"; {gaps} marked in them" if log.gaps else ""
    count = f"{log.transitions} transitions in " if log.paths else ""
    _print(f"{count}{join_names(map(str, files.written), most=20)}{lost}")


class _Files:
    """The output files: logs, and recordings for the viewer."""

    def __init__(self, outputs: Sequence[Path], drawing: DrawingOptions) -> None:
        from btcore_monitor.log_writer import LogWriter

        recordings = _filter_recordings(outputs)
        self.log = LogWriter([path for path in outputs if path not in recordings])
        self.sinks: list[RecordingSinks] = []
        self.views: list[RobotView] = []
        if recordings:
            from btcore_monitor.screen import robot_layouts, sinks

            self.sinks = [sinks.RecordingSinks(save=path) for path in recordings]
            layouts = [robot_layouts.SingleRobotLayout(destination) for destination in self.sinks]
            self.views = [drawing.create_view(layout) for layout in layouts]

    @property
    def written(self) -> list[Path]:
        """The files that have been created so far."""
        return [*self.log.files, *(path for view in self.views for path in view.files)]

    def process_event(self, event: Event) -> None:
        """Add *event* to every output file."""
        self.log.process_event(event)
        for view in self.views:
            view.process_event(event)

    def flush(self) -> None:
        """Write buffered data."""
        self.log.flush()
        for view in self.views:
            view.process_idle()

    def check(self) -> None:
        """Raise RecordingError if a recording cannot be written because the disk is full."""
        for destination in self.sinks:
            destination.check_files()

    def close(self) -> None:
        """Finish every file, even if closing another file fails."""
        # The stack calls all callbacks, even if one of them raises an exception.
        with contextlib.ExitStack() as stack:
            stack.callback(self.log.close)
            for view in self.views:
                stack.callback(view.close)


def _follow(feed: "Feed", files: _Files, watch: WatchOptions) -> None:
    shown = ""
    deadline = float("inf") if watch.duration is None else time.monotonic() + watch.duration
    with EndingSignals(feed.stop):
        for events in feed.batches():
            ended = False
            for event in events:
                files.process_event(event)
                # After a gap the same tree is seen again.
                if isinstance(event, TreeEvent) and event.tree.tree_id != shown:
                    shown = event.tree.tree_id
                    _print_source(event, statuses_only=not files.views)
                text = format_notice(event)
                if text:
                    _print(text)
                if isinstance(event, ConnectionEvent):
                    ended = event.state == "ended"
            files.flush()
            files.check()
            if (ended and watch.until_end) or time.monotonic() >= deadline:
                return


def _print_source(event: TreeEvent, statuses_only: bool) -> None:
    """Print the name of the recorded tree, and which data the files will not contain."""
    _print(f"recording '{event.tree.name}', {len(event.tree.nodes)} nodes")
    for kind, sentence in event.source.unavailable.items():
        _print(f"{kind}: {sentence}")
    if statuses_only:
        _print(_STATUSES_ONLY)


def _filter_recordings(outputs: Sequence[Path]) -> list[Path]:
    return [path for path in outputs if path.suffix == _RERUN]


def _check(outputs: Sequence[Path], known: Sequence[str]) -> None:
    seen: set[Path] = set()
    for path in outputs:
        if path.suffix not in known:
            raise click.UsageError(
                f"-o {path}: unknown file type; supported types are {join_names(known, 'and')}; "
                f"{suggestion(path.with_suffix(known[0]))}"
            )
        if path.resolve() in seen:
            raise click.UsageError(f"-o {path} is given twice")
        seen.add(path.resolve())
        check_writable("-o", path)


def _print(text: str) -> None:
    print_line(f"record: {text}", err=True)
