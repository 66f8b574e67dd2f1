"""`btcore monitor`: watch a robot live, record it, or take a screenshot."""

import contextlib
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from btcore.exit_codes import ExitCode
from btcore.field_options import pass_options
from btcore.options import changed_option_names
from btcore.signals import EndingSignals
from btcore_monitor.client_options import WatchOptions
from btcore_monitor.commands.notices import format_notice
from btcore_monitor.console import print_message
from btcore_monitor.environment_checks import check_folder, check_installed
from btcore_monitor.errors import RecordingError
from btcore_monitor.events import ConnectionEvent
from btcore_monitor.process_end import abandon, abandon_if_late, wait_for_stop
from btcore_monitor.viewer_options import (
    DRAWING_OPTION_NAMES,
    DrawingOptions,
    ViewerOptions,
)
from btcore_monitor.wire.groot2 import DEFAULT_ADDRESS

if TYPE_CHECKING:
    from btcore_monitor.screen.robot_layouts import RobotLayout
    from btcore_monitor.screen.robot_view import RobotView
    from btcore_monitor.screen.sinks import RecordingSinks
    from btcore_monitor.watch.feed import Feed

_RRF_MAGIC: Final = b"RRF"
"""The first bytes of rerun's files."""
_CHECK_INTERVAL_S: Final = 0.2
"""Time (s) between two checks whether all robots' threads have ended."""
_CHECK_FILE_INTERVAL_S: Final = 1.0
"""Time (s) between two checks whether the file of the recording can still be written."""
_CHECK_VIEWER_INTERVAL_S: Final = 2.0
"""Time (s) between two checks whether the viewer is still open."""


@click.command()
@click.argument("addresses", nargs=-1, metavar="[ADDRESS]...")
@pass_options(ViewerOptions, "options")
@pass_options(WatchOptions, "watch")
@click.option("--no-view", "--headless", "no_view", is_flag=True, help="Open no window.")
@click.option("--quiet", is_flag=True, help="Print problems only, not changes of the connection.")
def monitor(
    addresses: tuple[str, ...],
    options: ViewerOptions,
    watch: WatchOptions,
    no_view: bool,
    quiet: bool,
) -> None:
    """Watch the behavior trees at ADDRESS: of btcore, BehaviorTree.CPP or Nav2.

    ADDRESS is tcp://HOST:PORT, HOST:PORT, HOST or PORT (default: tcp://127.0.0.1:1667), or a recording
    FILE.rrd. The robot may start later, stop, and restart. Ctrl-C stops the monitor. Of several robots with
    keys, --robot-key is given once, or once for each ADDRESS in their order.

    \b
    Exit codes:
      0  the monitor ended normally
      1  --save wrote nothing, because no tree was seen
      2  an error
      4  the recording is incomplete, for example because the disk is full
    """
    check_installed("rerun", "zmq", "msgpack", "numpy")
    options.quiet_viewer()
    recordings = [Path(address) for address in addresses if address.endswith(".rrd")]
    robots = [address for address in addresses if not address.endswith(".rrd")]
    try:
        if recordings:
            if robots:
                raise click.UsageError("recordings and robots cannot be shown together")
            _reject_drawing_options(options)
            _show_recordings(recordings, options, watch.duration)
            return
        robots = robots or [DEFAULT_ADDRESS]
        robot_keys = watch.read(len(robots))
        with contextlib.ExitStack() as stack:
            _check_addresses(robots)
            # Before the robots notice their clients: `btcore run` begins when its viewer is connected.
            sinks = stack.enter_context(options.open_sinks(not no_view and options.screenshot is None))
            feeds = [
                stack.enter_context(watch.create_feed(robot, keys))
                for robot, keys in zip(robots, robot_keys, strict=True)
            ]
            with abandon_if_late(watch.duration):
                files = _watch(feeds, sinks, options, watch, quiet)
            options.take_screenshot(files)
            if files:
                return
            if options.screenshot is not None:
                raise click.ClickException(f"no tree was seen at {', '.join(robots)}, so there is no picture")
            if options.save is not None:
                print_message(f"no tree was seen at {', '.join(robots)}, so nothing was recorded")
                click.get_current_context().exit(ExitCode.FAILURE)
    except RecordingError as error:
        abandon(error)


def _reject_drawing_options(options: ViewerOptions) -> None:
    """Raise click.UsageError if there are drawing options: a recording was drawn already."""
    for name in changed_option_names(options):
        if name in DRAWING_OPTION_NAMES:
            raise click.UsageError(
                f"{name} has no effect on a recording: use it with a robot, or with btcore replay and a log"
            )


def _check_addresses(addresses: list[str]) -> None:
    """Raise AddressError if an address is invalid, and click.UsageError if one is given twice."""
    from btcore_monitor.watch.address import parse_address

    parsed = [parse_address(address) for address in addresses]
    for index, address in enumerate(parsed):
        if address in parsed[:index]:
            raise click.UsageError(f"{address} is given twice")


def _watch(
    feeds: "list[Feed]",
    sinks: "RecordingSinks",
    drawing: DrawingOptions,
    watch: WatchOptions,
    quiet: bool,
) -> list[Path]:
    """Show every feed, and return the written files, in the order of their trees.

    Return when all feeds have ended, on a signal, after the duration in *watch*, or when the user closes the
    viewer and no file is being written.
    """
    from btcore_monitor.screen.robot_layouts import SharedLayout, SingleRobotLayout

    stop = threading.Event()
    shared = SharedLayout(sinks, [_create_label(feed) for feed in feeds]) if len(feeds) > 1 else None
    layouts: Sequence[RobotLayout] = [SingleRobotLayout(sinks)] if shared is None else shared.slots
    views = [drawing.create_view(layout) for layout in layouts]
    errors: list[BaseException] = []

    def run(feed: "Feed", view: "RobotView") -> None:
        try:
            _process_feed(feed, view, watch.until_end, quiet)
        except BaseException as error:
            errors.append(error)
            stop.set()
        finally:
            try:
                view.close()
            except RecordingError as error:
                errors.append(error)

    # Signals arrive in this thread, so the robots are shown in other threads.
    threads = [
        threading.Thread(target=run, args=pair, name=f"monitor {pair[0].address}")
        for pair in zip(feeds, views, strict=True)
    ]
    with EndingSignals(stop.set):
        for thread in threads:
            thread.start()
        exit_code = _wait_for_end(threads, stop, sinks, watch.duration)
        for feed in feeds:
            feed.stop()
        for thread in threads:
            thread.join()
    if shared is not None:
        shared.close()
    if exit_code is not None:
        raise click.exceptions.Exit(exit_code)
    if errors:
        raise errors[0]
    return views[0].files if shared is None else shared.files


def _wait_for_end(
    threads: Sequence[threading.Thread],
    stop: threading.Event,
    sinks: "RecordingSinks",
    duration: float | None,
) -> ExitCode | None:
    """Wait as long as `_watch`, and return the exit code if the viewer has failed, otherwise None."""
    exit_code = None
    start = time.monotonic()
    next_file_check, next_viewer_check = start, start + _CHECK_VIEWER_INTERVAL_S
    viewer = sinks.viewer
    while any(thread.is_alive() for thread in threads) and not stop.wait(_CHECK_INTERVAL_S):
        now = time.monotonic()
        if now >= next_file_check:
            next_file_check = now + _CHECK_FILE_INTERVAL_S
            sinks.check_files()
        if duration is not None and now >= start + duration:
            break
        if viewer is None or now < next_viewer_check:
            continue
        next_viewer_check = now + _CHECK_VIEWER_INTERVAL_S
        if not viewer.is_open:
            failure, viewer = viewer.wait_for_failure(), None
            # Printed at once, because closing the recording takes some seconds without a viewer.
            print_message(f"the viewer (rerun) failed: {failure}" if failure else "the viewer was closed")
            if failure:
                exit_code = ExitCode.USER_ERROR
            if sinks.save is None:
                break
    return exit_code


def _create_label(feed: "Feed") -> str:
    """Return the label of a robot: `port PORT` on this machine, otherwise `HOST` or `HOST PORT`."""
    from btcore_monitor.wire.groot2 import DEFAULT_PORT

    host, port = feed.address.host, feed.address.port
    if host == "127.0.0.1":
        return f"port {port}"
    return host if port == DEFAULT_PORT else f"{host} {port}"


def _process_feed(feed: "Feed", view: "RobotView", until_end: bool, quiet: bool) -> None:
    for events in feed.batches(until_end):
        for event in events:
            view.process_event(event)
            text = format_notice(event)
            if text and not (quiet and isinstance(event, ConnectionEvent) and event.state != "lost"):
                print_message(text)
        if not events:
            view.process_idle()


def _show_recordings(recordings: list[Path], options: ViewerOptions, duration: float | None) -> None:
    from btcore_monitor.screen.sinks import open_viewer

    for recording in recordings:
        if not recording.is_file():
            raise click.UsageError(f"there is no recording {recording}")
        with recording.open("rb") as file:
            # Checked here, because the viewer would show the error only in its window.
            if not file.read(4).startswith(_RRF_MAGIC):
                raise click.UsageError(f"{recording} is not a rerun recording")
    if options.screenshot is not None:
        check_folder("--screenshot", options.screenshot)
        options.take_screenshot(recordings)
    elif options.serve_web is not None:
        options.open_web(options.serve_web).send_recordings(recordings)
        wait_for_stop(duration)
    else:
        open_viewer(options.memory_limit, files=recordings, verbose=options.verbose)
