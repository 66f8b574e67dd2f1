"""The process of rerun's viewer. All its ports are on 127.0.0.1, and it prints nothing unless it is asked to.

rerun reports usage statistics unless the user has disabled them. btcore's viewer reports them only if the
user has enabled them explicitly, with rerun's environment variable `FORCE_RERUN_ANALYTICS`.
"""

import contextlib
import importlib.util
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from rerun.experimental import ViewerClient

from btcore.extras import install_command
from btcore.signals import NEW_PROCESS_GROUP
from btcore_monitor.errors import MonitorError
from btcore_monitor.time_limits import VIEWER_START_TIMEOUT_S

LOOPBACK: Final = "127.0.0.1"
_DRAW_TIMEOUT_S: Final = 5.0
_END_TIMEOUT_S: Final = 2.0
_CLOSED: Final = (0, -signal.SIGTERM, -signal.SIGINT, -signal.SIGHUP if hasattr(signal, "SIGHUP") else 0)
"""Exit codes of a viewer that a user has closed."""
_PANIC: Final = re.compile(r"panicked at '(.*?)'$", re.MULTILINE)
_NO_DRIVER: Final = ("adapter", "ulkan", "Failed to get render context")
"""Texts of which the viewer prints one if it finds no driver."""
_MAX_REASON_CHARS: Final = 400


class ScreenError(MonitorError):
    """The viewer, a display, a driver or a port is not available; the message names alternatives."""


class RerunProcess:
    """A process of rerun with *options* that listens at a port.

    Args:
        options: Further options of rerun's command line.
        port: The preferred port at which the viewer receives recordings; another port is used if this port
            is in use. 0 means any port.
        verbose: Whether rerun prints its log lines on stderr.

    Raises:
        ScreenError: The viewer is not installed.
    """

    def __init__(self, *options: str, port: int = 0, verbose: bool = False) -> None:
        program = str(find_viewer_program())
        self._held = hold_port(port)
        self.port = port_of(self._held)
        self.address = address_of(self.port)
        command = [program, f"--bind={LOOPBACK}", f"--port={self.port}", *options]
        # A file and not a pipe, because a window stays open when this process ends.
        self._output = None if verbose else tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=2 if self._output is None else self._output,
            stderr=self._output,
            env=create_environment(verbose),
            # Ctrl-C in the terminal ends the monitor, but not the window.
            start_new_session=True,
            creationflags=NEW_PROCESS_GROUP,
        )

    def wait_until_listening(self, port: int | None = None) -> None:
        """Wait until the viewer accepts connections at *port* (default: its port for recordings).

        Raises:
            ScreenError: The viewer ends, or does not listen within `VIEWER_START_TIMEOUT_S`.
        """
        deadline = time.monotonic() + VIEWER_START_TIMEOUT_S
        while time.monotonic() < deadline:
            self._check_running()
            if is_listening(port or self.port):
                return
            time.sleep(0.05)
        raise ScreenError(f"the viewer (rerun) did not answer within {VIEWER_START_TIMEOUT_S:.0f} s")

    def wait_until_drawing(self) -> None:
        """Wait until the viewer answers from its window, or for some seconds: a hidden window may not answer.

        Raises:
            ScreenError: The viewer ends, for example because it cannot open its window.
        """
        # A window stays open without this process, but has its port from now on.
        with self._held:
            self.wait_until_listening()
        answered = threading.Event()

        def request() -> None:
            with contextlib.suppress(OSError, RuntimeError):
                ViewerClient.connect(self.address).get_state()
                answered.set()

        threading.Thread(target=request, daemon=True).start()
        deadline = time.monotonic() + _DRAW_TIMEOUT_S
        while not answered.wait(0.1) and time.monotonic() < deadline:
            self._check_running()

    def _check_running(self) -> None:
        if self._process.poll() is not None:
            reason = self.wait_for_failure() or "it was closed"
            raise ScreenError(f"the viewer (rerun) ended while starting: {reason}")

    def wait_for_failure(self) -> str | None:
        """Wait up to two seconds until the viewer has ended, and return the reason.

        Returns:
            The reason; None if the viewer is still running, or was closed by a user.
        """
        try:
            code = self._process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            return None
        if code in _CLOSED:
            return None
        text = self._read_output()
        if any(word in text for word in _NO_DRIVER):
            return (
                "it found no Vulkan driver; on Debian and Ubuntu `apt-get install mesa-vulkan-drivers "
                "libvulkan1` installs a software driver"
            )
        panic = _PANIC.search(text)
        return panic[1] if panic else text.strip()[-_MAX_REASON_CHARS:] or f"exit code {code}"

    def kill(self) -> None:
        """Kill the process without waiting."""
        self._process.kill()

    def close(self) -> None:
        """End the process."""
        self._held.close()
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._output is not None:
            self._output.close()

    def _read_output(self) -> str:
        if self._output is None:
            return ""
        self._output.seek(0)
        return self._output.read().decode(errors="replace")


def create_environment(verbose: bool = False) -> Mapping[str, str]:
    """Return the environment variables for rerun: no usage statistics, and only errors in its log.

    rerun's viewer also shows its log lines as pop-ups, which would be visible in pictures.
    """
    quiet = {} if verbose else {"RUST_LOG": "error"}
    # rerun sends no usage statistics if CI is set, unless FORCE_RERUN_ANALYTICS is set, too.
    return {**os.environ, **quiet, "CI": os.environ.get("CI", "true"), "RERUN_APP_ONLY": "true"}


def address_of(port: int) -> str:
    """Return the address at which rerun on this machine receives recordings at *port*."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def is_listening(port: int) -> bool:
    """Return whether a program on this machine accepts connections at *port*."""
    with contextlib.suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=1.0):
        return True
    return False


def hold_port(port: int = 0) -> socket.socket:
    """Hold *port* if it is free, otherwise another free port. 0 means any port.

    Until the returned socket is closed, other calls of this function, in any program, do not get the port,
    but rerun can listen at it on 127.0.0.1.
    """
    held = socket.socket()
    try:
        held.bind(("0.0.0.0", port))
    except OSError:
        held.bind(("0.0.0.0", 0))
    if sys.platform != "win32":
        # rerun sets this option, too. It is set after `bind`, which would otherwise share held ports.
        held.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    return held


def port_of(held: socket.socket) -> int:
    """Return the number of a held port."""
    return int(held.getsockname()[1])


def find_viewer_program() -> Path:
    """Return the path of the viewer's executable.

    This is not `bin/rerun`: that wrapper leaves the viewer running when the wrapper is terminated.

    Raises:
        ScreenError: The viewer is not installed.
    """
    spec = importlib.util.find_spec("rerun_cli")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        for name in ("rerun", "rerun.exe"):
            program = Path(folder) / name
            if program.exists():
                return program
    raise ScreenError(f"the rerun viewer is not installed: {install_command('rerun')}")
