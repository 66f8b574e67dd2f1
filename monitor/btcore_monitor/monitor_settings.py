"""The settings of a run for publishing, showing and recording it, and their checks."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Final, Literal

from msgspec.structs import replace

from btcore import Settings, SettingsError
from btcore.options import changed_option_names
from btcore_monitor.environment_checks import check_installed, check_is_recording, check_writable, has_display
from btcore_monitor.errors import MonitorError
from btcore_monitor.keys import RobotKeys
from btcore_monitor.viewer_options import DRAWING_OPTION_NAMES, OutputOptions, ViewerOptions, one_run_option
from btcore_monitor.wire.groot1 import PORT_BESIDE_GROOT2, PUBLISH_PORT
from btcore_monitor.wire.groot2 import DEFAULT_PORT

_GROOT1_OFFSET: Final = PORT_BESIDE_GROOT2 - DEFAULT_PORT
"""Offset of Groot 1's ports from Groot 2's ports if both are served: 1667 and 2666."""


class MonitorSettings(OutputOptions, Settings):
    """The options of a run for publishing and showing: `--publish`, `--monitor`, `--save`, …

    Raises:
        SettingsError: An option lacks another one, two exclude each other, or a file cannot be written.
        MonitorError: A package or a display is missing, or a key cannot be used.
    """

    monitor: Annotated[bool, one_run_option("Start the viewer and show the run live.")] = False
    publish: Annotated[
        tuple[Literal["groot2", "groot1"], ...],
        one_run_option(
            "Publish the run for Groot 2 or Groot 1 (or both: give it twice), and btcore's monitor."
        ),
    ] = ()
    bind: Annotated[
        str, one_run_option("Where to publish: an interface's address, or * for all.", metavar="ADDRESS")
    ] = "127.0.0.1"
    port: (
        Annotated[
            int,
            one_run_option(
                f"The first port; 0 chooses free ports.  [default: {DEFAULT_PORT}, for Groot 1 "
                f"{PUBLISH_PORT}; Groot 1 beside Groot 2 is {_GROOT1_OFFSET} further; a free port without "
                "--publish]",
                metavar="PORT",
                ge=0,
                le=65533,
            ),
        ]
        | None
    ) = None
    allow_control: Annotated[
        bool,
        one_run_option(
            "Let clients set breakpoints and inject statuses (btcore hook): with keys those of --allow-key, "
            "otherwise any client that reaches the port."
        ),
    ] = False
    allow_changes: Annotated[
        bool,
        one_run_option(
            "Let these clients also set entries of blackboards, and reload the tree between two ticks "
            "(btcore studio); with --bind only with keys."
        ),
    ] = False
    key_file: (
        Annotated[
            Path,
            one_run_option(
                "The robot's secret key (see btcore keys): encrypt connections, and accept only the clients "
                "of --allow-key.",
                metavar="FILE",
            ),
        ]
        | None
    ) = None
    allow_key: Annotated[
        tuple[str, ...],
        one_run_option(
            "With --key-file: the public key of a client that may connect, or a file with one key per line; "
            "may be given several times.",
            metavar="KEY",
        ),
    ] = ()
    watch_port: (
        Annotated[
            int,
            one_run_option(
                "With --key-file: the first of further ports where clients without keys, such as Groot, can "
                "watch but not control; 0 chooses free ports.",
                metavar="PORT",
                ge=0,
                le=65533,
            ),
        ]
        | None
    ) = None
    insecure: Annotated[
        bool, one_run_option("Permit --allow-control from the network (--bind) without keys.")
    ] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_needed_options()
        self.choose_ports()  # raises if the ports are out of range
        if self.save is not None:
            check_is_recording(self.save)

    def check_environment(self) -> None:
        """Check the files, the packages and the display that the settings need."""
        if self.key_file is not None:
            RobotKeys(self.key_file, self.allow_key)  # reads the keys
        for name, file in self.output_files.items():
            check_writable(name, file)
        if "groot1" in self.publish:
            check_installed("flatbuffers", needed_by="--publish groot1")
        if self.outputs:
            check_installed("rerun", needed_by=self.outputs[0])
        if self.monitor and not has_display():
            raise MonitorError(
                "--monitor: there is no display here. --serve-web shows the run in a browser, --save "
                "FILE.rrd records it for later, and --publish groot2 lets a monitor connect from elsewhere"
            )

    def _check_needed_options(self) -> None:
        """Raise SettingsError if an option has no effect, because it needs another one."""
        outputs = "--monitor, --serve-web, --save FILE.rrd or --screenshot FILE.png"
        needs: Sequence[tuple[Sequence[str], object, str]] = [
            ([*DRAWING_OPTION_NAMES, "--verbose"], self.outputs, outputs),
            (["--key-file", "--bind", "--port"], self.is_published, f"--publish, {outputs}"),
            (["--allow-control"], "groot2" in self.publish, "--publish groot2: Groot 1 has no control"),
            (["--allow-changes"], self.allow_control, "--allow-control"),
            (["--insecure"], self.allow_control, "--allow-control"),
            (["--key-file"], self.allow_key, "--allow-key with the public keys of the clients"),
            (["--allow-key", "--watch-port"], self.key_file, "--key-file with the robot's secret key"),
        ]
        given = changed_option_names(self)
        for names, needed, description in needs:
            for name in names:
                if name in given and not needed:
                    raise SettingsError(f"{name} needs {description}")

    @property
    def outputs(self) -> list[str]:
        """The given options that show or record the run, such as `--save`."""
        return [*super().outputs, *(["--monitor"] if self.monitor else [])]

    @property
    def is_published(self) -> bool:
        """Whether the run is published, for clients or for its own monitors."""
        return bool(self.publish or self.outputs)

    def list_viewer_options(self) -> list[ViewerOptions]:
        """Return the options of each `btcore monitor` that the run starts: for files, a window, browsers."""
        shown = ViewerOptions(
            palette=self.palette, find=self.find, log_level=self.log_level, verbose=self.verbose
        )
        files = [replace(shown, save=self.save, screenshot=self.screenshot)] if self.output_files else []
        window = [shown] if self.monitor else []
        browsers = [] if self.serve_web is None else [replace(shown, serve_web=self.serve_web)]
        return [*files, *window, *browsers]

    def choose_ports(self) -> tuple[int | None, int | None]:
        """Return the first port for Groot 2 and the first port for Groot 1; None: not served.

        Raises:
            SettingsError: The port for Groot 1 would be out of range.
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
            raise SettingsError(
                f"--port {groot2_port} leaves no port for Groot 1, which is {_GROOT1_OFFSET} further: choose "
                f"one up to {(1 << 16) - GROOT1_PORT_COUNT - _GROOT1_OFFSET}"
            )
        return groot2_port, groot1_port
