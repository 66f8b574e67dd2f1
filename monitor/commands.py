"""``btcore monitor``: watch a robot live, record it, or take its picture."""

import contextlib
import importlib.util
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from monitor.screen.sinks import Outlets
    from monitor.screen.stream import Screen
    from monitor.watch.feed import Feed

DEFAULT_ADDRESS: Final = "tcp://127.0.0.1:1667"
_RECORDING: Final = b"RRF"
"""What rerun's files begin with."""
_WAIT: Final = 0.2
"""s between two looks at a feed that says nothing."""
_LOOK_EVERY: Final = 2.0
"""s between two looks whether the viewer is still open."""
_NEEDED: Final = ("rerun", "zmq", "msgpack", "numpy")


class UsersMistake(click.ClickException):
    """What was asked for can't be had; the message says what can."""

    exit_code = 2


def _size(context: click.Context, option: click.Parameter, value: str) -> tuple[int, int]:
    width, _, height = value.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) >= 320 and int(height) >= 240):
        raise click.BadParameter(f"'{value}' is no size: write WIDTHxHEIGHT in pixels, such as 1920x1080")
    return int(width), int(height)


@click.command()
@click.argument("addresses", nargs=-1, metavar="[ADDRESS]...")
@click.option(
    "--save", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE.rrd", help="Record it."
)
@click.option(
    "--serve-web",
    type=click.IntRange(1, 65535),
    is_flag=False,
    flag_value=9090,
    metavar="[PORT]",
    help="Serve the viewer to browsers instead of opening a window.  [port: 9090]",
)
@click.option(
    "--screenshot",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE.png",
    help="Picture of the monitor at the end; needs no display.",
)
@click.option("--at", type=float, metavar="SECONDS", help="Tree time of the screenshot.  [default: the end]")
@click.option(
    "--size", default="1920x1080", callback=_size, show_default=True, metavar="WxH", help="Of the screenshot."
)
@click.option("--no-view", "--headless", "no_view", is_flag=True, help="Open no window.")
@click.option("--until-end", is_flag=True, help="Stop when the robot says that its run is over.")
@click.option("--for", "seconds", type=click.FloatRange(min=0), metavar="SECONDS", help="Stop after so long.")
@click.option(
    "--memory-limit",
    default="25%",
    show_default=True,
    metavar="SIZE",
    help="What the viewer may use before it drops its oldest data: 2GB, or a share of the memory.",
)
def monitor(
    addresses: tuple[str, ...],
    save: Path | None,
    serve_web: int | None,
    screenshot: Path | None,
    at: float | None,
    size: tuple[int, int],
    no_view: bool,
    until_end: bool,
    seconds: float | None,
    memory_limit: str,
) -> None:
    """Watch trees that run at ADDRESS: btcore's, BehaviorTree.CPP's, Nav2's.

    ADDRESS is tcp://HOST:PORT, HOST:PORT, HOST or PORT (default: tcp://127.0.0.1:1667), or a recording
    FILE.rrd. The robot may come later, go, and come back. Ctrl-C stops.
    """
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise UsersMistake(
            f"the monitor needs {missing[0]}, which isn't installed: pip install 'btcore[monitor]'"
        )
    from monitor.screen.sinks import ScreenFault

    watching = [one for one in addresses if not one.endswith(".rrd")] if addresses else [DEFAULT_ADDRESS]
    recordings = [Path(one) for one in addresses if one.endswith(".rrd")]
    try:
        if recordings:
            if watching:
                raise UsersMistake("a recording and a robot can't be watched at once: name one kind")
            _show_recordings(recordings, screenshot, serve_web, at, size, memory_limit, seconds)
            return
        with contextlib.ExitStack() as stack:
            if screenshot is not None:
                _check_folder("--screenshot", screenshot)
                if save is None:
                    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="btcore-"))
                    save = Path(folder) / "screenshot.rrd"
            feeds = [stack.enter_context(contextlib.closing(feed)) for feed in _feeds(watching)]
            wants_window = not no_view and screenshot is None and serve_web is None
            outlets = _outlets(save, serve_web, wants_window, memory_limit)
            files = _watch(feeds, outlets, until_end, seconds)
            if save is not None and not files and screenshot is None:
                seen_at = ", ".join(watching)
                click.echo(f"monitor: no tree was seen at {seen_at}, so nothing was recorded", err=True)
            if screenshot is not None:
                if not files:
                    raise UsersMistake(f"no tree was seen at {', '.join(watching)}, so there is no picture")
                _picture(files[-1], screenshot, at, size)
    except ScreenFault as fault:
        raise UsersMistake(str(fault)) from None


def _check_folder(option: str, path: Path) -> None:
    if not path.resolve().parent.is_dir():
        raise UsersMistake(f"{option} {path}: there is no folder {path.resolve().parent}")


def _feeds(addresses: list[str]) -> "list[Feed]":
    from monitor.watch.address import AddressFault
    from monitor.watch.feed import Feed

    try:
        return [Feed(address) for address in addresses]
    except AddressFault as fault:
        raise UsersMistake(str(fault)) from None


def _outlets(save: Path | None, web_port: int | None, window: bool, memory_limit: str) -> "Outlets":
    from monitor.screen.sinks import Outlets, open_window, serve_web

    if save is not None:
        _check_folder("--save", save)
    if web_port is not None:
        web = serve_web(web_port, memory_limit=memory_limit)
        click.echo(f"monitor: look at {web.page}", err=True)
        return Outlets(save=save, viewer=web.address, keep=web)
    if window:
        return Outlets(save=save, viewer=open_window(memory_limit))
    if save is None:
        raise UsersMistake(
            "--no-view leaves nothing to do: add --save FILE.rrd, --serve-web or --screenshot FILE.png"
        )
    return Outlets(save=save)


def _watch(feeds: "list[Feed]", outlets: "Outlets", until_end: bool, seconds: float | None) -> list[Path]:
    """Show every feed until told to stop; returns the files written, in the order of their trees."""
    from monitor.screen.sinks import answers
    from monitor.screen.stream import Screen

    stop = threading.Event()
    screens = [Screen(outlets) for _ in feeds]
    faults: list[BaseException] = []

    def run(feed: "Feed", screen: Screen) -> None:
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
    with _stopped_by_signals(stop):
        for thread in threads:
            thread.start()
        deadline = None if seconds is None else time.monotonic() + seconds
        watched, look_at = outlets.viewer, time.monotonic() + _LOOK_EVERY
        while any(thread.is_alive() for thread in threads) and not stop.wait(_WAIT):
            now = time.monotonic()
            if deadline is not None and now >= deadline:
                break
            if watched is not None and now >= look_at:
                look_at = now + _LOOK_EVERY
                if not answers(watched):
                    watched = None
                    click.echo("monitor: the viewer was closed", err=True)
                    if outlets.save is None:
                        break
        stop.set()
        for thread in threads:
            thread.join()
    if faults:
        raise faults[0]
    return [file for screen in screens for file in screen.files]


def _show(feed: "Feed", screen: "Screen", until_end: bool, stop: threading.Event) -> None:
    from monitor.picture import Link
    from monitor.watch.feed import ABANDONED_AFTER

    away_since: float | None = time.monotonic()
    while not stop.is_set():
        events = feed.poll(_WAIT)
        for event in events:
            screen.show(event)
            if isinstance(event, Link):
                click.echo(f"monitor: {event.detail or event.state}", err=True)
                away_since = None if event.state == "connected" else time.monotonic()
                if event.state == "ended" and until_end:
                    return
        if not events:
            screen.flush()
            if until_end and away_since is not None and time.monotonic() - away_since > ABANDONED_AFTER:
                return


@contextlib.contextmanager
def _stopped_by_signals(stop: threading.Event) -> Iterator[None]:
    """Ctrl-C and a kind request to end set *stop*, so that files are finished."""

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    before = {number: signal.signal(number, handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _show_recordings(
    recordings: list[Path],
    picture: Path | None,
    web_port: int | None,
    at: float | None,
    size: tuple[int, int],
    memory_limit: str,
    seconds: float | None,
) -> None:
    from monitor.screen.sinks import open_window, serve_web

    for recording in recordings:
        if not recording.is_file():
            raise UsersMistake(f"there is no recording {recording}")
        with recording.open("rb") as file:
            if not file.read(4).startswith(_RECORDING):
                raise UsersMistake(f"{recording} is no recording of rerun")
    if picture is not None:
        _check_folder("--screenshot", picture)
        _picture(recordings[-1], picture, at, size)
        return
    if web_port is None:
        open_window(memory_limit, files=recordings)
        return
    web = serve_web(web_port, memory_limit=memory_limit)
    web.show(recordings)
    click.echo(f"monitor: look at {web.page}; Ctrl-C ends it", err=True)
    stop = threading.Event()
    with _stopped_by_signals(stop):
        stop.wait(seconds)


def _picture(recording: Path, picture: Path, at: float | None, size: tuple[int, int]) -> None:
    from monitor.screen.screenshot import screenshot

    screenshot(recording, picture, at, size)
    click.echo(f"monitor: the picture is {picture}", err=True)
