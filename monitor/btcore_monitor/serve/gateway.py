"""Start and stop the process between the clients and the publisher's sockets.

The publisher's sockets are bound to Unix sockets in a folder that only this user can open. The clients
connect to TCP ports of the gateway's process (gateway_process.py), which enforces limits. On Windows, which
lacks Unix sockets, a thread does the same by TCP.
"""

import contextlib
import json
import logging
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import Final, NamedTuple

import zmq

from btcore_monitor.serve import gateway_process

Socket = zmq.Socket[bytes]

_PREFIX: Final = "btcore-gateway-"
"""The beginning of the name of the folder with the sockets."""

_MAX_PATH: Final = 75
"""Maximum length of the path of the folder for temporary files: a Unix socket's path has up to 103 bytes."""

_PROGRAM: Final = (
    "import sys; sys.path.append(sys.argv[1]); import gateway_process; gateway_process.main(sys.argv[2])"
)
"""The program of the process: unlike a script, an imported module is not compiled at each start."""

_HANDSHAKE_MS: Final = 5_000
"""Maximum time for the handshake of a connection."""

_HAS_UNIX_SOCKETS: Final = sys.platform != "win32"

_ATTEMPTS: Final = 10
"""Maximum attempts to create a folder that no other process removes."""

_CLOSE_TIMEOUT_S: Final = 2 * gateway_process.FLUSH_TIMEOUT_S
"""Maximum seconds (wall clock) for the process to end."""

_log = logging.getLogger("monitor")


class _PortSettings(NamedTuple):
    """The arguments of `gateway_process.Port`, but with the file descriptor of the listening socket."""

    descriptor: int
    path: str
    takes_topics: bool
    replies: bool
    size: int


class Gateway:
    """Connects TCP ports to sockets of ZeroMQ. Call `add_port` for each port, then `start`."""

    def __init__(self) -> None:
        parent = Path(tempfile.gettempdir())
        if _HAS_UNIX_SOCKETS and len(str(parent)) > _MAX_PATH:
            parent = Path("/tmp")
        _remove_abandoned(parent)
        self._folder, self._lock = _create_locked(parent)
        self._listeners: list[socket.socket] = []
        self._ports: list[_PortSettings] = []
        self._process: subprocess.Popen[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._control_socket: socket.socket | None = None

    def add_port(self, listener: socket.socket, target: Socket) -> None:
        """Forward the connections of *listener* to *target*.

        Args:
            listener: A listening socket. The gateway closes it.
            target: A ROUTER, PUB or XPUB socket with MAXMSGSIZE. This method binds it.
        """
        target.setsockopt(zmq.HANDSHAKE_IVL, _HANDSHAKE_MS)
        if _HAS_UNIX_SOCKETS:
            path = str(self._folder / str(len(self._ports)))
            target.bind(f"ipc://{path}")
        else:
            target.bind("tcp://127.0.0.1:*")
            path = target.getsockopt_string(zmq.LAST_ENDPOINT).rstrip("\0")
        self._listeners.append(listener)
        socket_type = target.getsockopt(zmq.TYPE)
        size = target.getsockopt(zmq.MAXMSGSIZE)
        assert isinstance(size, int)
        takes_topics, replies = socket_type != zmq.ROUTER, socket_type != zmq.PUB
        self._ports.append(_PortSettings(listener.fileno(), path, takes_topics, replies, size))

    def start(self) -> None:
        """Accept connections from now on."""
        # A program that contains Python can't be started as an interpreter.
        is_python = not getattr(sys, "frozen", False) and "python" in Path(sys.executable or "").name
        reads, self._control_socket = socket.socketpair()
        if not is_python or not _HAS_UNIX_SOCKETS:
            self._run_in_thread(reads)
            return
        settings = json.dumps([port._asdict() for port in self._ports])
        folder = str(Path(gateway_process.__file__).parent)
        command = [sys.executable, "-I", "-S", "-c", _PROGRAM, folder, settings]
        try:
            self._process = subprocess.Popen(
                command,
                stdin=reads.fileno(),
                stdout=subprocess.DEVNULL,
                pass_fds=[port.descriptor for port in self._ports],
                start_new_session=True,  # Ctrl-C ends the robot, and then the robot ends the gateway
            )
        except OSError as error:
            _log.warning("the process for the monitor's connections can't be started: %s", error)
            self._run_in_thread(reads)
        else:
            reads.close()

    def restart_if_ended(self) -> None:
        """Continue in a thread if the process ended, for instance because the system killed it."""
        process = self._process
        if process is not None and process.poll() is not None:
            self._process = None
            _log.warning(
                "the process for the monitor's connections ended with code %d; a thread continues",
                process.returncode,
            )
            self._close_control_socket()
            reads, self._control_socket = socket.socketpair()
            self._run_in_thread(reads)

    def _run_in_thread(self, control_socket: socket.socket) -> None:
        ports = [
            gateway_process.Port(listener.dup(), port.path, port.takes_topics, port.replies, port.size)
            for listener, port in zip(self._listeners, self._ports, strict=True)
        ]
        self._thread = threading.Thread(
            target=_run_and_close, args=(ports, control_socket), name="btcore-gateway", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Close all connections and ports. Bytes that the sockets have sent are forwarded first."""
        self._close_control_socket()
        if self._process is not None:
            try:
                self._process.wait(_CLOSE_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._thread is not None:
            self._thread.join()
        for listener in self._listeners:
            listener.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _close_control_socket(self) -> None:
        if self._control_socket is not None:
            # A byte, because a fork of this process may hold the connection open.
            with contextlib.suppress(OSError):
                self._control_socket.send(b".")
            self._control_socket.close()
            self._control_socket = None


def _create_locked(parent: Path) -> tuple[Path, int | None]:
    """Create a folder for sockets in *parent*, and lock it until this process ends.

    Return the folder, and the file descriptor of the lock, or None if the system cannot lock folders.
    """
    for _ in range(_ATTEMPTS if _HAS_UNIX_SOCKETS else 0):
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent))
        lock = _try_lock(folder)
        if lock is not None:
            return folder, lock
        # Another process has found the folder before it was locked, and removes it.
        shutil.rmtree(folder, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=_PREFIX, dir=parent)), None


def _remove_abandoned(parent: Path) -> None:
    """Remove the folders in *parent* of killed robots whose gateways were killed, too."""
    if sys.platform == "win32":
        return
    with contextlib.suppress(OSError):
        for folder in parent.glob(f"{_PREFIX}*"):
            if folder.lstat().st_uid == os.getuid() and (lock := _try_lock(folder)) is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(lock)


def _try_lock(folder: Path) -> int | None:
    """Lock *folder*, and return the file descriptor of the lock, or None if another process has locked it."""
    if sys.platform == "win32":
        return None
    import fcntl

    try:
        lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(lock), folder.lstat()):
            return lock
    except OSError:
        pass
    os.close(lock)
    return None


def _run_and_close(ports: list[gateway_process.Port], control_socket: socket.socket) -> None:
    with control_socket:
        gateway_process.Forwarder(ports, control_socket.fileno()).run()
