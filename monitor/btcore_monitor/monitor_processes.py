"""The processes of `btcore monitor` that show and record a run, from their start to their end."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from btcore.options import arguments
from btcore.signals import NEW_PROCESS_GROUP, delayed_signals
from btcore_monitor.client_options import KeyOptions
from btcore_monitor.console import print_message
from btcore_monitor.errors import MonitorError
from btcore_monitor.time_limits import (
    CONNECT_TIMEOUT_S,
    PICTURE_TIMEOUT_S,
    SHOW_TIMEOUT_S,
    WRITE_TIMEOUT_S,
)
from btcore_monitor.viewer_options import ViewerOptions

if TYPE_CHECKING:
    from btcore_monitor.serve import Publisher

_ANNOUNCE_START_AFTER_S: Final = 10.0
_ANNOUNCE_END_AFTER_S: Final = 5.0
"""Times (s, wall clock) of waiting after which a message is printed that explains the wait."""

_CHECK_INTERVAL_S: Final = 0.2


class MonitorProcess:
    """A process of `btcore monitor`, which starts the viewer as a further process (`RerunProcess`).

    Args:
        address: The address of the publisher to which it connects.
        options: What it shows and writes. It opens a window if they name neither files nor a port.
        keys: The keys with which it connects.
    """

    def __init__(self, address: str, options: ViewerOptions, keys: KeyOptions) -> None:
        files = options.output_files
        self.writes_file = bool(files)
        self.takes_screenshot = options.screenshot is not None
        self.serves_web = options.serve_web is not None
        self.label = f"writing {' and '.join(map(str, files.values()))}" if files else "the viewer"
        if self.serves_web:
            self.label = "the viewer for browsers"
        flags = {
            "--no-view": self.writes_file,
            "--until-end": not self.serves_web,
            "--quiet": not options.verbose,
        }
        home = str(Path(__file__).parent.parent)
        path = os.pathsep.join([home, *filter(None, [os.environ.get("PYTHONPATH")])])
        # In its own session, Ctrl-C ends only the run, and the recording is still completed.
        self.process = subprocess.Popen(
            [
                # -P: a module in the working directory must not replace an installed module.
                *[sys.executable, "-P", "-m", "btcore_monitor", address],
                *[flag for flag, is_set in flags.items() if is_set],
                *arguments(options),
                *arguments(keys),
            ],
            stdin=subprocess.DEVNULL,
            # The results of the run are on stdout, messages of the monitor are on stderr.
            stdout=2,
            start_new_session=True,
            creationflags=NEW_PROCESS_GROUP,
            env=os.environ | {"PYTHONPATH": path},
        )

    def finish(self) -> str:
        """Wait until the process has received all data and ended; return why it failed, or ""."""
        timeout = WRITE_TIMEOUT_S if self.writes_file else SHOW_TIMEOUT_S
        if self.takes_screenshot:
            timeout += PICTURE_TIMEOUT_S
        try:
            code = self._wait(timeout)
        except subprocess.TimeoutExpired:
            lost = "so the picture is missing" if self.takes_screenshot else "so its end may be missing"
            return f"{self.label}: not finished {timeout:g} s after the run, {lost}"
        return f"{self.label}: the monitor's process failed with exit code {code}" if code else ""

    def _wait(self, timeout: float) -> int:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return self.process.wait(_ANNOUNCE_END_AFTER_S)
        waiting = "the picture is drawn" if self.takes_screenshot else "all data is received"
        print_message(f"{self.label}: waiting until {waiting}")
        return self.process.wait(timeout - _ANNOUNCE_END_AFTER_S)

    def wait_for_signal(self) -> None:
        """Let a viewer for browsers stay open until Ctrl-C or the end of its process."""
        with contextlib.suppress(KeyboardInterrupt):
            if self.process.poll() is None:
                print_message(f"the run is over; {self.label} stays open until Ctrl-C")
            # On Windows, Ctrl-C does not end a wait for a process.
            while self.process.poll() is None:
                time.sleep(_CHECK_INTERVAL_S)


@contextlib.contextmanager
def start_monitors(
    address: str, viewers: Sequence[ViewerOptions], keys: KeyOptions
) -> Iterator[list[MonitorProcess]]:
    """Start a process for each of *viewers* that connects to *address*; all have ended after the context.

    Args:
        address: The address of the publisher.
        viewers: The options of each process.
        keys: The keys with which the processes connect.
    """
    started: list[MonitorProcess] = []
    try:
        with delayed_signals():
            for options in viewers:
                started.append(MonitorProcess(address, options, keys))
        yield started
    finally:
        for monitor in started:
            monitor.process.terminate()
        try:
            with contextlib.suppress(subprocess.TimeoutExpired):
                for monitor in started:
                    monitor.process.wait(SHOW_TIMEOUT_S)
        finally:
            for monitor in started:
                monitor.process.kill()
                monitor.process.wait()


def finish_monitors(monitors: Sequence[MonitorProcess], stay_open: bool) -> list[str]:
    """Wait for the ends of processes, and print the failures of those that write no file.

    Args:
        stay_open: Whether viewers for browsers stay open until a signal. Otherwise they are not waited for.

    Returns:
        The reasons why files are incomplete.
    """
    failures: list[str] = []
    for monitor in monitors:
        if monitor.serves_web:
            if stay_open:
                monitor.wait_for_signal()
        elif failure := monitor.finish():
            if monitor.writes_file:
                failures.append(failure)
            else:
                print_message(failure)
    return failures


def wait_until_connected(publisher: "Publisher", monitors: Sequence[MonitorProcess]) -> None:
    """Wait until as many clients as *monitors* have connected, so that they receive the run's beginning.

    Any client counts. If too few have connected after CONNECT_TIMEOUT_S, print a message and return.

    Args:
        publisher: The publisher to which the monitors connect.
        monitors: The processes to wait for.

    Raises:
        MonitorError: A process ends before all have connected.
    """
    start = time.monotonic()
    is_announced = False
    while not publisher.wait_for_clients(len(monitors), 0.1):
        for monitor in monitors:
            code = monitor.process.poll()
            if code is not None:
                raise MonitorError(
                    f"{monitor.label}: the monitor's process ended before the run, with exit code {code}"
                )
        waited = time.monotonic() - start
        if waited > CONNECT_TIMEOUT_S:
            print_message(f"no connection after {CONNECT_TIMEOUT_S:g} s; the run begins without the monitor")
            return
        if waited > _ANNOUNCE_START_AFTER_S and not is_announced:
            is_announced = True
            print_message("waiting until the monitor is connected; Ctrl-C ends the run")
