"""The monitor's part of `btcore run`: publishing, the viewer, and the recording.

The viewer and the recording are separate processes that subscribe to the published data, so that the robot's
process never draws. All messages go to stderr.
"""

import importlib.util
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from btcore.extras import install_command
from btcore.run_extension import OutputError, RunExtension
from btcore.tree.tree import Tree
from btcore_monitor.display import has_display
from btcore_monitor.drawing_options import DrawingOptions, create_drawing_options, list_given_options
from btcore_monitor.keys import KeyFileError, RobotKeys, create_keys
from btcore_monitor.monitor_process import MonitorProcess, print_message, wait_until_connected
from btcore_monitor.output_files import check_is_recording, check_writable
from btcore_monitor.process_end import exit_on_sigterm
from btcore_monitor.viewer_options import DESTINATIONS
from btcore_monitor.wire.groot1 import PORT_BESIDE_GROOT2, PUBLISH_PORT
from btcore_monitor.wire.groot2 import DEFAULT_PORT

if TYPE_CHECKING:
    from btcore_monitor.serve import Publisher

_GROOT1_OFFSET: Final = PORT_BESIDE_GROOT2 - DEFAULT_PORT
"""Offset of Groot 1's ports from Groot 2's ports if both are served: 1667 and 2666."""


class MonitorExtension(RunExtension):
    """The options of `run` for publishing and showing: `--publish`, `--monitor`, `--save`, …"""

    options: Sequence[click.Option] = (
        click.Option(
            ["--publish"],
            type=click.Choice(["groot2", "groot1"]),
            multiple=True,
            help="Publish the run for Groot 2 or Groot 1 (or both: give it twice), and btcore's monitor.",
        ),
        click.Option(
            ["--bind"],
            default="127.0.0.1",
            show_default=True,
            metavar="ADDRESS",
            help="Where to publish: an interface's address, or * for all.",
        ),
        click.Option(
            ["--port"],
            type=click.IntRange(0, 65533),
            metavar="PORT",
            help=f"The first port; 0 chooses free ports.  [default: {DEFAULT_PORT}, for Groot 1 "
            f"{PUBLISH_PORT}; Groot 1 beside Groot 2 is {_GROOT1_OFFSET} further; a free port for --monitor "
            "and --save alone]",
        ),
        click.Option(
            ["--allow-control"],
            is_flag=True,
            help="Let clients set breakpoints and inject statuses (btcore hook): with keys those of "
            "--allow-key, otherwise any client that reaches the port.",
        ),
        click.Option(
            ["--key-file"],
            type=click.Path(path_type=Path),
            metavar="FILE",
            help="The robot's secret key (see btcore keys): encrypt connections, and accept only the clients "
            "of --allow-key.",
        ),
        click.Option(
            ["--allow-key"],
            multiple=True,
            metavar="KEY",
            help="With --key-file: the public key of a client that may connect, or a file with one key per "
            "line; may be given several times.",
        ),
        click.Option(
            ["--watch-port"],
            type=click.IntRange(0, 65533),
            metavar="PORT",
            help="With --key-file: the first of further ports where clients without keys, such as Groot, can "
            "watch but not control; 0 chooses free ports.",
        ),
        click.Option(
            ["--insecure"],
            is_flag=True,
            help="Permit --allow-control from the network (--bind) without keys.",
        ),
        click.Option(["--monitor"], is_flag=True, help="Start the viewer and show the run live."),
        click.Option(
            ["--serve-web"],
            **DESTINATIONS["--serve-web"],
            help="Show the run live to browsers, and its end until Ctrl-C.  [port: 9090]",
        ),
        click.Option(["--save"], **DESTINATIONS["--save"], help="Record the run for the viewer (rerun)."),
        click.Option(
            ["--screenshot"],
            **DESTINATIONS["--screenshot"],
            help="Write a picture of the monitor at the last tick after the run; needs no display.",
        ),
        click.Option(
            ["--verbose"],
            is_flag=True,
            help="Print the log of the viewer (rerun), and when the viewer and the recording connect.",
        ),
        *create_drawing_options(),
    )
    single_run_options: Sequence[str] = tuple(option.name or "" for option in options)

    def __init__(self) -> None:
        self._publisher: Publisher | None = None
        self._is_interrupted = False

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object]
    ) -> Sequence[object]:
        """Provide nothing: only check the options, before other extensions build a simulated world.

        Raises:
            click.UsageError: The options contradict each other, or a file cannot be written.
            click.ClickException: A package or a display is missing.
        """
        _choose_ports(settings)
        if "groot1" in settings["publish"] and importlib.util.find_spec("flatbuffers") is None:
            raise click.ClickException(
                "--publish groot1 needs flatbuffers, which is not installed: "
                f"{install_command('flatbuffers')}"
            )
        if settings["allow_control"] and "groot2" not in settings["publish"]:
            raise click.UsageError("--allow-control needs --publish groot2, since Groot 1 has no control")
        _check_keys(settings)
        save: Path | None = settings["save"]
        if save is not None:
            check_is_recording(save)
        for option, file in _list_output_files(settings).items():
            check_writable(option, file)
        given = _list_view_options(settings)
        if given and importlib.util.find_spec("rerun") is None:
            raise click.ClickException(
                f"{given[0]} needs rerun, which is not installed: {install_command('rerun')}"
            )
        if not given:
            for option in list_given_options():
                raise click.UsageError(
                    f"{option} has no effect without a view: add --monitor, --serve-web, --save FILE.rrd or "
                    "--screenshot FILE.png"
                )
        if settings["monitor"] and not has_display():
            raise click.ClickException(
                "--monitor: there is no display here. --serve-web shows the run in a browser, --save "
                "FILE.rrd records it for later, and --publish groot2 lets a monitor connect from elsewhere"
            )
        return ()

    def replace_tree(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> None:
        """Publish *tree* instead of the previous tree; clients stay connected."""
        if self._publisher is not None:
            self._publisher.replace_tree(tree, resources)

    def on_interrupt(self) -> None:
        """Don't wait for viewers at the end."""
        self._is_interrupted = True

    @contextmanager
    def attach(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> Iterator[None]:
        """Publish *tree* during the run, and start the monitor's processes, according to the options.

        Raises:
            click.ClickException: The tree cannot be published, or a monitor process ends early.
            OutputError: On exit: the file of --save is incomplete, or there is no picture for --screenshot.
        """
        if not settings["publish"] and not _list_view_options(settings):
            yield
            return
        with ExitStack() as stack:
            # The loop of ticks handles signals only later.
            delayed_exit = stack.enter_context(exit_on_sigterm())
            keys, key_options = _create_robot_keys(settings, stack)
            publisher = stack.enter_context(_start_publisher(tree, resources, settings, keys))
            _print_addresses(publisher, settings, keys)
            monitors: list[MonitorProcess] = []
            try:
                with delayed_exit():
                    for options, label, stays_open in _list_monitors(settings, key_options):
                        monitors.append(MonitorProcess(publisher, options, label, stays_open))
                wait_until_connected(publisher, monitors)
                self._publisher = publisher
                yield
            # After an error, do not wait for viewers.
            except BaseException:
                self._is_interrupted = True
                raise
            finally:
                failures = self._finish(publisher, monitors)
            if failures:
                raise OutputError("; ".join(failures))

    def _finish(self, publisher: "Publisher", monitors: Sequence[MonitorProcess]) -> list[str]:
        """End the stream, wait for the monitors, and return why their files are incomplete."""
        from btcore_monitor.serve.publisher import INTERRUPTED_GRACE_S

        self._publisher = None
        # Before waiting: a monitor process ends when it has received the end of the stream.
        publisher.end_stream()
        failures = [monitor.finish(self._is_interrupted) for monitor in monitors]
        if self._is_interrupted:
            publisher.close(INTERRUPTED_GRACE_S)
        return [failure for failure in failures if failure]


def _start_publisher(
    tree: Tree, resources: Sequence[object], settings: Mapping[str, Any], keys: RobotKeys | None
) -> "Publisher":
    # Imported here, because most runs publish nothing, and the import takes a tenth of a second.
    from btcore_monitor.serve import PortInUseError, ServeError, serve

    groot2_port, groot1_port = _choose_ports(settings)
    try:
        return serve(
            tree,
            groot2_port=groot2_port,
            groot1_port=groot1_port,
            bind=settings["bind"],
            resources=resources,
            allow_control=settings["allow_control"],
            keys=keys,
            watch_port=settings["watch_port"],
            insecure=settings["insecure"],
        )
    except ServeError as error:
        hint = settings.get("port_hint", "") if isinstance(error, PortInUseError) else ""
        raise click.ClickException(f"{error}{hint}") from None


def _print_addresses(publisher: "Publisher", settings: Mapping[str, Any], keys: RobotKeys | None) -> None:
    if settings["publish"] or settings["verbose"]:
        with_keys = "" if keys is None else f" --key-file YOURS --robot-key {keys.public}"
        print_message(f"publishing at {publisher.address} (btcore monitor {publisher.address}{with_keys})")
    if publisher.watch_address:
        print_message(f"watching without keys: {publisher.watch_address}")
    # Groot cannot use keys, so it connects to the ports for watching without keys.
    updates_port = publisher.groot1_port if keys is None else publisher.watch_groot1_port
    if updates_port is not None:
        reason = f", since Groot 2 has {publisher.port}" if "groot2" in settings["publish"] else ""
        print_message(
            f"Groot 1 finds it at publisher port {updates_port} and server port {updates_port + 1}{reason}"
        )


def _list_monitors(
    settings: Mapping[str, Any], key_options: Sequence[str]
) -> Iterator[tuple[list[str], str, bool]]:
    """Yield the last three arguments of each `MonitorProcess` of the run."""
    options = [*key_options, *DrawingOptions.from_settings(settings).arguments()]
    options.append("--verbose" if settings["verbose"] else "--quiet")
    files = _list_output_files(settings)
    if files:
        arguments = [str(part) for item in files.items() for part in item]
        label = f"writing {' and '.join(map(str, files.values()))}"
        yield [*arguments, "--no-view", *options], label, False
    if settings["monitor"]:
        yield options, "the monitor", False
    if settings["serve_web"]:
        yield ["--serve-web", str(settings["serve_web"]), *options], "the viewer for browsers", True


def _list_view_options(settings: Mapping[str, Any]) -> list[str]:
    """Return the options on the command line that show or record the run, such as `--save`."""
    given = {"--monitor": settings["monitor"], "--serve-web": settings["serve_web"] is not None}
    return [*_list_output_files(settings), *(option for option, is_given in given.items() if is_given)]


def _list_output_files(settings: Mapping[str, Any]) -> dict[str, Path]:
    """Return the options that name a file to write, with their files."""
    options = {"--save": settings["save"], "--screenshot": settings["screenshot"]}
    return {option: file for option, file in options.items() if file is not None}


def _check_keys(settings: Mapping[str, Any]) -> None:
    """Raise click.UsageError if the options about keys are incomplete or name unusable keys."""
    if settings["key_file"] is None:
        for option in ("allow_key", "watch_port"):
            if settings[option] not in (None, ()):
                name = option.replace("_", "-")
                raise click.UsageError(f"--{name} needs --key-file with the robot's secret key")
        return
    if not settings["publish"] and not _list_view_options(settings):
        raise click.UsageError("--key-file needs --publish: nothing is published")
    if not settings["allow_key"]:
        raise click.UsageError("--key-file needs --allow-key with the public keys of the clients")
    try:
        RobotKeys(settings["key_file"], settings["allow_key"])
    except KeyFileError as error:
        raise click.UsageError(str(error)) from None


def _create_robot_keys(settings: Mapping[str, Any], stack: ExitStack) -> tuple[RobotKeys | None, list[str]]:
    """Return the keys of the robot, and the options with which its own monitors connect.

    The monitors get a key pair of their own, in a temporary folder that *stack* removes.
    """
    if settings["key_file"] is None:
        return None, []
    key = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="btcore-"))) / "monitor"
    try:
        keys = RobotKeys(settings["key_file"], [*settings["allow_key"], create_keys(key)])
    except KeyFileError as error:
        raise click.ClickException(str(error)) from None
    return keys, ["--key-file", str(key), "--robot-key", keys.public]


def _choose_ports(settings: Mapping[str, Any]) -> tuple[int | None, int | None]:
    """Return the first port for Groot 2 and the first port for Groot 1; None: not served.

    Raises:
        click.UsageError: The port for Groot 1 would be out of range.
    """
    publish, first = settings["publish"], settings["port"]
    if "groot1" not in publish:
        return (DEFAULT_PORT if publish else 0) if first is None else first, None
    if "groot2" not in publish:
        return None, PUBLISH_PORT if first is None else first
    from btcore_monitor.serve.tcp_ports import GROOT1_PORT_COUNT

    groot2_port = DEFAULT_PORT if first is None else first
    groot1_port = groot2_port + _GROOT1_OFFSET if groot2_port else 0
    if groot1_port + GROOT1_PORT_COUNT > 1 << 16:
        raise click.UsageError(
            f"--port {groot2_port} leaves no port for Groot 1, which is {_GROOT1_OFFSET} further: choose one "
            f"up to {(1 << 16) - GROOT1_PORT_COUNT - _GROOT1_OFFSET}"
        )
    return groot2_port, groot1_port
