"""``btcore monitor``: watch a robot live, record it, or take a screenshot."""

import contextlib
import tempfile
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from btcore_monitor.display_options import DisplayOptions, explicit_options
from btcore_monitor.viewer_setup import (
    check_folder,
    check_installed,
    duration_option,
    open_sinks,
    robot_options,
    save_screenshot,
    stop_on_signals,
    viewer_options,
)

if TYPE_CHECKING:
    from btcore_monitor.screen.robot_view import RobotView
    from btcore_monitor.screen.sinks import RecordingSinks
    from btcore_monitor.watch.feed import Feed

DEFAULT_ADDRESS: Final = "tcp://127.0.0.1:1667"
_RECORDING: Final = b"RRF"
"""The first bytes of rerun's files."""
_WAIT: Final = 0.2
"""Time (s) between two checks of an idle feed."""
_LOOK_EVERY: Final = 2.0
"""Time (s) between two checks whether the viewer is still open."""


@click.command()
@click.argument("addresses", nargs=-1, metavar="[ADDRESS]...")
@viewer_options
@robot_options
@click.option("--no-view", "--headless", "no_view", is_flag=True, help="Open no window.")
@click.option("--until-end", is_flag=True, help="Stop when the robot reports the end of its run.")
@duration_option
def monitor(
    addresses: tuple[str, ...],
    save: Path | None,
    serve_web: int | None,
    screenshot: Path | None,
    at: float | None,
    size: tuple[int, int],
    memory_limit: str,
    display: DisplayOptions,
    no_record: bool,
    blackboard_rate: float,
    no_view: bool,
    until_end: bool,
    duration: float | None,
) -> None:
    """Watch the behavior trees at ADDRESS: of btcore, BehaviorTree.CPP or Nav2.

    ADDRESS is tcp://HOST:PORT, HOST:PORT, HOST or PORT (default: tcp://127.0.0.1:1667), or a recording
    FILE.rrd. The robot may start later, stop, and restart. Ctrl-C stops the monitor.
    """
    check_installed("rerun", "zmq", "msgpack", "numpy")
    from btcore_monitor.screen.sinks import ScreenError

    watching = [one for one in addresses if not one.endswith(".rrd")] if addresses else [DEFAULT_ADDRESS]
    recordings = [Path(one) for one in addresses if one.endswith(".rrd")]
    try:
        if recordings:
            if watching:
                raise click.UsageError("a recording and a robot can't be watched at once: name one kind")
            _check_is_live()
            _show_recordings(recordings, screenshot, serve_web, at, size, memory_limit, duration)
            return
        with contextlib.ExitStack() as stack:
            if screenshot is not None:
                check_folder("--screenshot", screenshot)
                if save is None:
                    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="btcore-"))
                    save = Path(folder) / "screenshot.rrd"
            feeds = _feeds(watching, blackboard_rate, not no_record)
            for feed in feeds:
                stack.enter_context(contextlib.closing(feed))
            wants_window = not no_view and screenshot is None and serve_web is None
            sinks = open_sinks(save, serve_web, wants_window, memory_limit)
            files = _watch(feeds, sinks, display, until_end, duration)
            if save is not None and not files and screenshot is None:
                seen_at = ", ".join(watching)
                click.echo(f"monitor: no tree was seen at {seen_at}, so nothing was recorded", err=True)
            if screenshot is not None:
                if not files:
                    raise click.ClickException(
                        f"no tree was seen at {', '.join(watching)}, so there is no picture"
                    )
                save_screenshot(files[-1], screenshot, at, size)
    except ScreenError as fault:
        raise click.ClickException(str(fault)) from None


def _check_is_live() -> None:
    """Raise click.UsageError if there are display options, because a recording keeps its own options."""
    for option in explicit_options():
        raise click.UsageError(
            f"a recording is shown as it was made: {option} goes with watching a robot, and with btcore "
            "replay of a log"
        )


def _feeds(addresses: list[str], blackboard_rate: float, record: bool) -> "list[Feed]":
    from btcore_monitor.watch.address import AddressError, parse_address
    from btcore_monitor.watch.feed import Feed

    try:
        places = [parse_address(one) for one in addresses]
    except AddressError as fault:
        raise click.UsageError(str(fault)) from None
    for at, place in enumerate(places):
        if place in places[:at]:
            raise click.UsageError(f"{place} is named twice, and one window shows a robot once")
    return [Feed(one, blackboard_rate=blackboard_rate, record=record) for one in addresses]


def _watch(
    feeds: "list[Feed]",
    sinks: "RecordingSinks",
    display: DisplayOptions,
    until_end: bool,
    duration: float | None,
) -> list[Path]:
    """Show every feed until the end, and return the files written, in the order of their trees."""
    from btcore_monitor.screen.sinks import is_viewer_open
    from btcore_monitor.screen.viewer_windows import SharedWindow

    stop = threading.Event()
    together = SharedWindow(sinks, [_called(feed) for feed in feeds])
    screens = [display.screen(slot) for slot in together.slots] if len(feeds) > 1 else [display.screen(sinks)]
    faults: list[BaseException] = []

    def run(feed: "Feed", screen: "RobotView") -> None:
        try:
            _show(feed, screen, until_end, stop)
        except BaseException as fault:
            faults.append(fault)
            stop.set()
        finally:
            screen.close()

    threads = [
        threading.Thread(target=run, args=pair, name=f"monitor {pair[0].address}")
        for pair in zip(feeds, screens, strict=True)
    ]
    with stop_on_signals(stop):
        for thread in threads:
            thread.start()
        deadline = None if duration is None else time.monotonic() + duration
        watched, look_at = sinks.viewer, time.monotonic() + _LOOK_EVERY
        while any(thread.is_alive() for thread in threads) and not stop.wait(_WAIT):
            now = time.monotonic()
            if deadline is not None and now >= deadline:
                break
            if watched is not None and now >= look_at:
                look_at = now + _LOOK_EVERY
                if not is_viewer_open(watched):
                    watched = None
                    click.echo("monitor: the viewer was closed", err=True)
                    if sinks.save is None:
                        break
        stop.set()
        for thread in threads:
            thread.join()
    together.close()
    if faults:
        raise faults[0]
    return together.files or screens[0].files


def _called(feed: "Feed") -> str:
    """Return the name of a robot among several: the shortest form of its address."""
    from btcore_monitor.wire.groot2 import DEFAULT_PORT

    host, port = feed.address.host, feed.address.port
    if host == "127.0.0.1":
        return f"port {port}"
    return host if port == DEFAULT_PORT else f"{host} {port}"


def _show(feed: "Feed", screen: "RobotView", until_end: bool, stop: threading.Event) -> None:
    from btcore_monitor.events import ConnectionChanged
    from btcore_monitor.watch.feed import ABANDONED_AFTER

    away_since: float | None = time.monotonic()
    while not stop.is_set():
        events = feed.poll(_WAIT)
        for event in events:
            screen.show(event)
            if isinstance(event, ConnectionChanged):
                click.echo(f"monitor: {event.detail or event.state}", err=True)
                away_since = None if event.state == "connected" else time.monotonic()
                if event.state == "ended" and until_end:
                    return
        if not events:
            screen.flush()
            if until_end and away_since is not None and time.monotonic() - away_since > ABANDONED_AFTER:
                return


def _show_recordings(
    recordings: list[Path],
    picture: Path | None,
    web_port: int | None,
    at: float | None,
    size: tuple[int, int],
    memory_limit: str,
    duration: float | None,
) -> None:
    from btcore_monitor.screen.sinks import open_window, serve_web

    for recording in recordings:
        if not recording.is_file():
            raise click.UsageError(f"there is no recording {recording}")
        with recording.open("rb") as file:
            if not file.read(4).startswith(_RECORDING):
                raise click.UsageError(f"{recording} is no recording of rerun")
    if picture is not None:
        check_folder("--screenshot", picture)
        save_screenshot(recordings[-1], picture, at, size)
        return
    if web_port is None:
        open_window(memory_limit, files=recordings)
        return
    web = serve_web(web_port, memory_limit=memory_limit)
    web.show(recordings)
    click.echo(f"monitor: look at {web.page}; Ctrl-C ends it", err=True)
    stop = threading.Event()
    with stop_on_signals(stop):
        stop.wait(duration)
