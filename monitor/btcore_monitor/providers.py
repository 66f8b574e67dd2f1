"""The provider of `btcore run` for publishing, the viewer, and the recording.

The viewer and the recording are separate processes that subscribe to the published data, so that the robot's
process never draws. All messages go to stderr.
"""

import functools
import importlib.util
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import click

from btcore import OutputError, Report, Resources, Settings, option, provider
from btcore.extras import install_command
from btcore.runs.settings import arguments, option_names
from btcore.signals import delayed_signals
from btcore.tree.tree import Tree
from btcore_monitor.display import has_display
from btcore_monitor.drawing_options import DrawingSettings, FindOption, LogLevelOption, PaletteOption
from btcore_monitor.errors import MonitorError
from btcore_monitor.key_options import KeySettings
from btcore_monitor.keys import KeyFileError, RobotKeys, create_keys
from btcore_monitor.monitor_process import MonitorProcess, print_message, wait_until_connected
from btcore_monitor.output_files import check_is_recording, check_writable
from btcore_monitor.viewer_options import ViewerSettings
from btcore_monitor.wire.groot1 import PORT_BESIDE_GROOT2, PUBLISH_PORT
from btcore_monitor.wire.groot2 import DEFAULT_PORT

if TYPE_CHECKING:
    from btcore_monitor.serve import Publisher

_GROOT1_OFFSET: Final = PORT_BESIDE_GROOT2 - DEFAULT_PORT
"""Offset of Groot 1's ports from Groot 2's ports if both are served: 1667 and 2666."""

_option: Final = functools.partial(option, one_run_only=True)


class MonitorSettings(Settings):
    """The options of a run for publishing and showing: `--publish`, `--monitor`, `--save`, …

    Raises:
        click.UsageError: The options contradict each other, or a file cannot be written.
        click.ClickException: A package or a display is missing.
    """

    publish: Annotated[
        tuple[Literal["groot2", "groot1"], ...],
        _option("Publish the run for Groot 2 or Groot 1 (or both: give it twice), and btcore's monitor."),
    ] = ()
    bind: Annotated[
        str, _option("Where to publish: an interface's address, or * for all.", metavar="ADDRESS")
    ] = "127.0.0.1"
    port: (
        Annotated[
            int,
            _option(
                f"The first port; 0 chooses free ports.  [default: {DEFAULT_PORT}, for Groot 1 "
                f"{PUBLISH_PORT}; Groot 1 beside Groot 2 is {_GROOT1_OFFSET} further; a free port for "
                "--monitor and --save alone]",
                metavar="PORT",
                ge=0,
                le=65533,
            ),
        ]
        | None
    ) = None
    allow_control: Annotated[
        bool,
        _option(
            "Let clients set breakpoints and inject statuses (btcore hook): with keys those of --allow-key, "
            "otherwise any client that reaches the port."
        ),
    ] = False
    key_file: (
        Annotated[
            Path,
            _option(
                "The robot's secret key (see btcore keys): encrypt connections, and accept only the clients "
                "of --allow-key.",
                metavar="FILE",
            ),
        ]
        | None
    ) = None
    allow_key: Annotated[
        tuple[str, ...],
        _option(
            "With --key-file: the public key of a client that may connect, or a file with one key per line; "
            "may be given several times.",
            metavar="KEY",
        ),
    ] = ()
    watch_port: (
        Annotated[
            int,
            _option(
                "With --key-file: the first of further ports where clients without keys, such as Groot, can "
                "watch but not control; 0 chooses free ports.",
                metavar="PORT",
                ge=0,
                le=65533,
            ),
        ]
        | None
    ) = None
    insecure: Annotated[bool, _option("Permit --allow-control from the network (--bind) without keys.")] = (
        False
    )
    monitor: Annotated[bool, _option("Start the viewer and show the run live.")] = False
    serve_web: (
        Annotated[
            int,
            _option(
                "Show the run live to browsers, and its end until Ctrl-C.  [port: 9090]",
                metavar="[PORT]",
                ge=1,
                le=65535,
                bare_value=9090,
            ),
        ]
        | None
    ) = None
    save: Annotated[Path, _option("Record the run for the viewer (rerun).", metavar="FILE.rrd")] | None = None
    screenshot: (
        Annotated[
            Path,
            _option(
                "Write a picture of the monitor at the last tick after the run; needs no display.",
                metavar="FILE.png",
            ),
        ]
        | None
    ) = None
    verbose: Annotated[
        bool,
        _option("Print the log of the viewer (rerun), and when the viewer and the recording connect."),
    ] = False
    palette: PaletteOption | None = None
    find: FindOption = ()
    log_level: LogLevelOption = "trace"

    def __post_init__(self) -> None:
        self.choose_ports()
        if "groot1" in self.publish and importlib.util.find_spec("flatbuffers") is None:
            raise click.ClickException(
                "--publish groot1 needs flatbuffers, which is not installed: "
                f"{install_command('flatbuffers')}"
            )
        if self.allow_control and "groot2" not in self.publish:
            raise click.UsageError("--allow-control needs --publish groot2, since Groot 1 has no control")
        self._check_keys()
        if self.save is not None:
            check_is_recording(self.save)
        for name, file in self.output_files.items():
            check_writable(name, file)
        self._check_views()

    def _check_keys(self) -> None:
        """Raise click.UsageError if the options about keys are incomplete or name unusable keys."""
        if self.key_file is None:
            for name, value in {"--allow-key": self.allow_key, "--watch-port": self.watch_port}.items():
                if value not in (None, ()):
                    raise click.UsageError(f"{name} needs --key-file with the robot's secret key")
            return
        if not self.is_published:
            raise click.UsageError("--key-file needs --publish: nothing is published")
        if not self.allow_key:
            raise click.UsageError("--key-file needs --allow-key with the public keys of the clients")
        try:
            RobotKeys(self.key_file, self.allow_key)
        except KeyFileError as error:
            raise click.UsageError(str(error)) from None

    def _check_views(self) -> None:
        drawing = option_names(self.drawing)
        if not self.view_options:
            for name in drawing:
                raise click.UsageError(
                    f"{name} has no effect without a view: add --monitor, --serve-web, --save FILE.rrd or "
                    "--screenshot FILE.png"
                )
            return
        if importlib.util.find_spec("rerun") is None:
            raise click.ClickException(
                f"{self.view_options[0]} needs rerun, which is not installed: {install_command('rerun')}"
            )
        if self.monitor and not has_display():
            raise click.ClickException(
                "--monitor: there is no display here. --serve-web shows the run in a browser, --save "
                "FILE.rrd records it for later, and --publish groot2 lets a monitor connect from elsewhere"
            )

    @property
    def drawing(self) -> DrawingSettings:
        """The drawing options."""
        return DrawingSettings(self.palette, self.find, self.log_level)

    @property
    def output_files(self) -> dict[str, Path]:
        """The options that name a file to write, with their files."""
        files = {"--save": self.save, "--screenshot": self.screenshot}
        return {name: file for name, file in files.items() if file is not None}

    @property
    def view_options(self) -> list[str]:
        """The given options that show or record the run, such as `--save`."""
        views = {"--monitor": self.monitor, "--serve-web": self.serve_web}
        return [*self.output_files, *(name for name, value in views.items() if value)]

    @property
    def is_published(self) -> bool:
        """Whether the run is published, for clients or for its own viewers."""
        return bool(self.publish or self.view_options)

    def choose_ports(self) -> tuple[int | None, int | None]:
        """Return the first port for Groot 2 and the first port for Groot 1; None: not served.

        Raises:
            click.UsageError: The port for Groot 1 would be out of range.
        """
        first = self.port
        if "groot1" not in self.publish:
            return (DEFAULT_PORT if self.publish else 0) if first is None else first, None
        if "groot2" not in self.publish:
            return None, PUBLISH_PORT if first is None else first
        from btcore_monitor.serve.tcp_ports import GROOT1_PORT_COUNT

        groot2_port = DEFAULT_PORT if first is None else first
        groot1_port = groot2_port + _GROOT1_OFFSET if groot2_port else 0
        if groot1_port + GROOT1_PORT_COUNT > 1 << 16:
            raise click.UsageError(
                f"--port {groot2_port} leaves no port for Groot 1, which is {_GROOT1_OFFSET} further: choose "
                f"one up to {(1 << 16) - GROOT1_PORT_COUNT - _GROOT1_OFFSET}"
            )
        return groot2_port, groot1_port


class PortOptionError(MonitorError, click.UsageError):
    """Another program uses the port.

    Attributes:
        option: The setting that chooses the port: "port" or "watch_port".
    """

    def __init__(self, message: str, option: str) -> None:
        super().__init__(message)
        self.option = option


@provider
def publisher(
    settings: MonitorSettings, tree: Tree, resources: Resources, report: Report
) -> Iterator[object]:
    """Publish the tree during the run, and start the monitor's processes, according to the settings.

    Raises:
        click.ClickException: The tree cannot be published, or a monitor process ends early.
        OutputError: On exit: the file of --save is incomplete, or there is no picture for --screenshot.
    """
    if not settings.is_published:
        yield None
        return
    with (
        _robot_keys(settings) as (keys, client_keys),
        _start_publisher(tree, resources, settings, keys) as publisher,
    ):
        _print_addresses(publisher, settings, keys)
        monitors: list[MonitorProcess] = []
        try:
            with delayed_signals():
                for options, label, stays_open in _list_monitors(settings, client_keys):
                    monitors.append(MonitorProcess(publisher, options, label, stays_open))
            wait_until_connected(publisher, monitors)
            yield publisher
        finally:
            is_interrupted = report.end_reason in (None, "interrupted")
            failures = _finish(publisher, monitors, is_interrupted)
            if failures:
                raise OutputError("; ".join(failures))


def _finish(publisher: "Publisher", monitors: Sequence[MonitorProcess], is_interrupted: bool) -> list[str]:
    """End the stream, wait for the monitors, and return why their files are incomplete."""
    from btcore_monitor.serve.publisher import INTERRUPTED_GRACE_S

    # Before waiting: a monitor process ends when it has received the end of the stream.
    publisher.end_stream()
    failures = [monitor.finish(is_interrupted) for monitor in monitors]
    if is_interrupted:
        publisher.close(INTERRUPTED_GRACE_S)
    return [failure for failure in failures if failure]


def _start_publisher(
    tree: Tree, resources: Sequence[object], settings: MonitorSettings, keys: RobotKeys | None
) -> "Publisher":
    # Imported here, because most runs publish nothing, and the import takes a tenth of a second.
    from btcore_monitor.serve import PortInUseError, ServeError, serve

    groot2_port, groot1_port = settings.choose_ports()
    try:
        return serve(
            tree,
            groot2_port=groot2_port,
            groot1_port=groot1_port,
            bind=settings.bind,
            resources=resources,
            allow_control=settings.allow_control,
            keys=keys,
            watch_port=settings.watch_port,
            insecure=settings.insecure,
        )
    except PortInUseError as error:
        raise PortOptionError(str(error), error.option.removeprefix("--").replace("-", "_")) from None
    except ServeError as error:
        raise click.ClickException(str(error)) from None


def _print_addresses(publisher: "Publisher", settings: MonitorSettings, keys: RobotKeys | None) -> None:
    if settings.publish or settings.verbose:
        with_keys = "" if keys is None else f" --key-file YOURS --robot-key {keys.public}"
        print_message(f"publishing at {publisher.address} (btcore monitor {publisher.address}{with_keys})")
    if publisher.watch_address:
        print_message(f"watching without keys: {publisher.watch_address}")
    # Groot cannot use keys, so it connects to the ports for watching without keys.
    updates_port = publisher.groot1_port if keys is None else publisher.watch_groot1_port
    if updates_port is not None:
        reason = f", since Groot 2 has {publisher.port}" if "groot2" in settings.publish else ""
        print_message(
            f"Groot 1 finds it at publisher port {updates_port} and server port {updates_port + 1}{reason}"
        )


def _list_monitors(settings: MonitorSettings, keys: KeySettings) -> Iterator[tuple[list[str], str, bool]]:
    """Yield the last three arguments of each `MonitorProcess` of the run."""
    common = [*arguments(keys), *arguments(settings.drawing), *([] if settings.verbose else ["--quiet"])]

    def options(**destinations: Any) -> list[str]:
        return [*arguments(ViewerSettings(verbose=settings.verbose, **destinations)), *common]

    files = settings.output_files
    if files:
        label = f"writing {' and '.join(map(str, files.values()))}"
        yield [*options(save=settings.save, screenshot=settings.screenshot), "--no-view"], label, False
    if settings.monitor:
        yield options(), "the monitor", False
    if settings.serve_web:
        yield options(serve_web=settings.serve_web), "the viewer for browsers", True


@contextmanager
def _robot_keys(settings: MonitorSettings) -> Iterator[tuple[RobotKeys | None, KeySettings]]:
    """Return a context with the keys of the robot, and the keys with which its own monitors connect.

    The monitors get a key pair of their own, in a temporary folder that exists as long as the context.
    """
    if settings.key_file is None:
        yield None, KeySettings()
        return
    with tempfile.TemporaryDirectory(prefix="btcore-") as folder:
        key = Path(folder) / "monitor"
        try:
            keys = RobotKeys(settings.key_file, [*settings.allow_key, create_keys(key)])
        except KeyFileError as error:
            raise click.ClickException(str(error)) from None
        yield keys, KeySettings(key, (keys.public,))
