"""The provider of `btcore run` that publishes the run for clients, and for its own viewers and recordings.

Viewers and recordings are processes of `btcore monitor`, which connect like any other client, so that the
robot's process never draws. All messages go to stderr.
"""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from btcore import OutputError, Report, Resources, provider
from btcore.errors import SettingsError
from btcore.tree.tree import Tree
from btcore_monitor.client_options import KeyOptions
from btcore_monitor.console import print_message
from btcore_monitor.keys import RobotKeys, create_keys
from btcore_monitor.monitor_processes import finish_monitors, start_monitors, wait_until_connected
from btcore_monitor.monitor_settings import MonitorSettings
from btcore_monitor.time_limits import INTERRUPTED_GRACE_S

if TYPE_CHECKING:
    from btcore_monitor.serve import Publisher


@provider
def publisher(
    settings: MonitorSettings, tree: Tree, resources: Resources, report: Report
) -> Iterator[object]:
    """Publish the tree during the run, and start the processes that show and record it.

    Raises:
        MonitorError: The tree cannot be published, or a process ends before the run.
        OutputError: On exit: the file of --save is incomplete, or there is no picture for --screenshot.
    """
    if not settings.is_published:
        yield None
        return
    with (
        _prepare_keys(settings) as (robot_keys, client_keys),
        _publish(tree, resources, settings, robot_keys) as published,
        start_monitors(published.address, settings.list_viewer_options(), client_keys) as monitors,
    ):
        _print_addresses(published, settings, robot_keys)
        wait_until_connected(published, monitors)
        try:
            yield published
        finally:
            # After an interrupt or an error, no viewer for browsers stays open, and foreign clients get 2 s
            # for what they have not received. Recordings and windows of the run are completed in any case.
            ends_early = report.end_reason in (None, "interrupted", "program_error")
            # Before waiting: a monitor ends when it has received the end of the stream.
            published.end_stream()
            failures = finish_monitors(monitors, stay_open=not ends_early)
            published.close(INTERRUPTED_GRACE_S if ends_early else None)
            if failures:
                raise OutputError("; ".join(failures))


@contextmanager
def _prepare_keys(settings: MonitorSettings) -> Iterator[tuple[RobotKeys | None, KeyOptions]]:
    """Read the keys of the robot, create a key pair for its own monitors, and yield both.

    The key pair of the monitors is in a temporary folder that exists as long as the context.
    """
    if settings.key_file is None:
        yield None, KeyOptions()
        return
    with tempfile.TemporaryDirectory(prefix="btcore-") as folder:
        key = Path(folder) / "monitor"
        keys = RobotKeys(settings.key_file, [*settings.allow_key, create_keys(key)])
        yield keys, KeyOptions(key_file=key, robot_keys=(keys.public,))


def _publish(
    tree: Tree, resources: Sequence[object], settings: MonitorSettings, keys: RobotKeys | None
) -> "Publisher":
    # Imported here, because most runs publish nothing, and the import takes a tenth of a second.
    from btcore_monitor.serve import PortInUseError, serve

    groot2_port, groot1_port = settings.choose_ports()
    try:
        return serve(
            tree,
            groot2_port=groot2_port,
            groot1_port=groot1_port,
            bind=settings.bind,
            resources=resources,
            allow_control=settings.allow_control,
            allow_changes=settings.allow_changes,
            keys=keys,
            watch_port=settings.watch_port,
            insecure=settings.insecure,
        )
    except PortInUseError as error:
        raise SettingsError(str(error), error.setting) from None


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
