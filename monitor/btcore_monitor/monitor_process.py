"""A process of `btcore monitor` that records or shows a run of `btcore run`."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from btcore.process_group import NEW_PROCESS_GROUP
from btcore_monitor.console import print_line
from btcore_monitor.process_end import stop_on_signals

if TYPE_CHECKING:
    from btcore_monitor.serve import Publisher

CONNECT_TIMEOUT_S: Final = 30.0
"""Time (s, wall clock) for a monitor process to start and connect before the first tick."""

WRITE_TIMEOUT_S: Final = 60.0
"""Time (s, wall clock) for a recording process to finish its file after the last tick."""

PICTURE_TIMEOUT_S: Final = 900.0
"""Further time (s, wall clock) for a process that also draws a picture, which is slow on a busy machine."""

VIEWER_GRACE_S: Final = 10.0
"""Time (s, wall clock) for the viewer to receive the remaining data after the last tick."""

_ANNOUNCE_AFTER_S: Final = 2.0
"""Time (s, wall clock) of waiting after which a message is printed that explains the wait."""

_CHECK_INTERVAL_S: Final = 0.2


class MonitorProcess:
    """A process of `btcore monitor`, which starts the viewer as a further process (`RerunProcess`).

    Args:
        publisher: The publisher to which the process connects.
        options: Further options of `btcore monitor`.
        label: The purpose of the process, for messages.
        stays_open: Whether the process continues after the run, until Ctrl-C.
    """

    def __init__(
        self, publisher: "Publisher", options: Sequence[str], label: str, stays_open: bool = False
    ) -> None:
        self.label = label
        self.takes_screenshot = "--screenshot" in options
        self.writes_file = self.takes_screenshot or "--save" in options
        self.stays_open = stays_open
        home = str(Path(__file__).parent.parent)
        path = os.pathsep.join([home, *filter(None, [os.environ.get("PYTHONPATH")])])
        until = [] if stays_open else ["--until-end"]
        # In its own session, Ctrl-C ends only the run, and the recording is still completed.
        self.process = subprocess.Popen(
            # -P: a module in the working directory must not replace an installed module.
            [sys.executable, "-P", "-m", "btcore_monitor", publisher.address, *until, *options],
            stdin=subprocess.DEVNULL,
            # The results of the run are on stdout, messages of the monitor are on stderr.
            stdout=2,
            start_new_session=True,
            creationflags=NEW_PROCESS_GROUP,
            env=os.environ | {"PYTHONPATH": path},
        )

    def finish(self, is_interrupted: bool) -> str:
        """Wait until the process has received all data and written its files, within this module's limits.

        A process that stays after the run is ended on a signal, or at once if *is_interrupted*.

        Returns:
            The reason why the file that the process writes is incomplete, or "".
        """
        if self.stays_open:
            self._keep_open(is_interrupted)
            return ""
        timeout = WRITE_TIMEOUT_S if self.writes_file else VIEWER_GRACE_S
        if self.takes_screenshot:
            timeout += PICTURE_TIMEOUT_S
        try:
            code = self._wait(timeout)
        except subprocess.TimeoutExpired:
            self.process.terminate()
            lost = "so the picture is missing" if self.takes_screenshot else "so its end may be missing"
            reason = f"{self.label}: not finished {timeout:g} s after the run, {lost}"
            if self.writes_file:
                return reason
            print_message(reason)
            return ""
        except BaseException:
            self.process.terminate()
            raise
        if code and self.writes_file:
            return f"{self.label}: the monitor's process failed with exit code {code}"
        return ""

    def _wait(self, timeout: float) -> int:
        deadline = time.monotonic() + timeout
        if not self.writes_file:
            return self.process.wait(timeout)
        try:
            return self.process.wait(_ANNOUNCE_AFTER_S)
        except subprocess.TimeoutExpired:
            waiting = "the picture is drawn" if self.takes_screenshot else "all data is received"
            print_message(f"{self.label}: waiting until {waiting}")
            return self.process.wait(max(0.0, deadline - time.monotonic()))

    def _keep_open(self, is_interrupted: bool) -> None:
        stop = threading.Event()
        with stop_on_signals(stop):
            if not is_interrupted and self.process.poll() is None:
                print_message(f"the run is over; {self.label} stays open until Ctrl-C")
                while self.process.poll() is None and not stop.wait(_CHECK_INTERVAL_S):
                    pass
            self.process.terminate()
            try:
                self.process.wait(VIEWER_GRACE_S)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()


def wait_until_connected(publisher: "Publisher", monitors: Sequence[MonitorProcess]) -> None:
    """Wait until as many clients as *monitors* have connected, so that they receive the run's beginning.

    Any client counts. If too few have connected after CONNECT_TIMEOUT_S, print a message and return.

    Args:
        publisher: The publisher to which the monitors connect.
        monitors: The processes to wait for.

    Raises:
        click.ClickException: A process ends before all have connected.
    """
    deadline = time.monotonic() + CONNECT_TIMEOUT_S
    while not publisher.wait_for_clients(len(monitors), 0.1):
        for monitor in monitors:
            code = monitor.process.poll()
            if code is not None:
                raise click.ClickException(
                    f"{monitor.label}: the monitor's process ended at once, with exit code {code}"
                )
        if time.monotonic() > deadline:
            print_message(
                f"the monitor is not listening after {CONNECT_TIMEOUT_S:g} s; the run begins without it"
            )
            return


def print_message(text: str) -> None:
    """Print *text* to stderr, separate from the results of the run."""
    print_line(f"monitor: {text}", err=True)
