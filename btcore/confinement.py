"""Confine a process that works for an agent: its files, connections, programs, memory and processor time.

The limits are in an environment variable, so that processes which the process starts have them, too.
"""

import errno
import json
import os
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final, NamedTuple

VARIABLE: Final = "BTCORE_CONFINEMENT"
"""The environment variable with the limits, as JSON."""

_READING: Final = "reading"
_WRITING: Final = "writing"
_LOOPBACK: Final = ("127.0.0.1", "::1", "localhost")
# What libraries read of the machine. The environment of a process is not among it.
_SYSTEM: Final = re.compile(
    r"/dev/(null|urandom)|/etc/(localtime|os-release)|/usr/share/zoneinfo(/.*)?|/sys(/.*)?"
    r"|/proc/(meminfo|cpuinfo|stat|uptime|mounts)"
    r"|/proc/(self|[0-9]+)(/(stat|statm|status|cgroup|mounts|mountinfo|maps|task|fd))?"
    r"|/System/Library/CoreServices/SystemVersion\.plist"
    if sys.platform != "win32"
    else "(?!)"
)
# The audit events of functions that change files; their first argument is a path. In the second group, the
# second argument is a path, too.
_CHANGES: Final = frozenset(
    f"os.{name}"
    for name in ("chmod", "chown", "mkdir", "remove", "rmdir", "truncate", "utime", "setxattr", "removexattr")
)
_CHANGES_OF_TWO: Final = frozenset({"os.link", "os.rename", "os.symlink"})
_LISTINGS: Final = frozenset({"os.listdir", "os.scandir"})
_CONNECTIONS: Final = frozenset({"socket.bind", "socket.connect", "socket.sendto", "socket.sendmsg"})
_PROGRAMS: Final = frozenset({"subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn"})

_limited = False  # whether `limit_process` was called


class Confinement(NamedTuple):
    """The limits of a process and of the processes that it starts.

    Attributes:
        readable: The folders whose files it may read, besides the installed Python code.
        writable: The folder in which it may write files.
        loopback: Whether it may connect to its own machine.
        memory: The maximum size of its data (bytes), where the operating system can limit it.
        file_size: The maximum size of a file that it writes (bytes), likewise.
        cpu_seconds: The processor time (s) after which it is killed, likewise.
    """

    readable: tuple[str, ...]
    writable: str
    loopback: bool
    memory: int
    file_size: int
    cpu_seconds: int

    def to_environment(self) -> dict[str, str]:
        """Return the environment variable for a process with these limits."""
        return {VARIABLE: json.dumps(self._asdict())}


def confine_process() -> None:
    """Apply the limits in the environment variable to this process; without it, do nothing.

    The limits cannot be removed again. Python reports each access to a file to the check; libraries in C
    that open files themselves are not checked.
    """
    text = os.environ.get(VARIABLE)
    if not text:
        return
    limits = Confinement(**json.loads(text))
    # Windows has no such limits; the time limit of the call remains.
    limit_process(
        RLIMIT_CORE=0,
        RLIMIT_CPU=limits.cpu_seconds,
        RLIMIT_DATA=limits.memory,
        RLIMIT_FSIZE=limits.file_size,
    )
    sys.addaudithook(_check_of(limits))


def _check_of(limits: Confinement) -> Callable[[str, tuple[Any, ...]], None]:
    """Return the audit hook that raises PermissionError for what *limits* forbid."""
    writable = _real_paths([limits.writable])
    code = [sys.prefix, sys.base_prefix, sys.exec_prefix, *sys.path, str(Path(__file__).parents[2])]
    readable = [*writable, *_real_paths([*limits.readable, *code])]

    def check(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            path, mode, flags = arguments
            if not isinstance(path, (str, bytes)):
                return  # the number of an open file
            writes = _is_write(mode, flags)
            _require(path, writable if writes else readable, _WRITING if writes else _READING)
        elif event in _LISTINGS:
            _require(arguments[0], readable, _READING)
        elif event in _CHANGES or event in _CHANGES_OF_TWO:
            for path in arguments[: 2 if event in _CHANGES_OF_TWO else 1]:
                _require(path, writable, _WRITING)
        elif event in _CONNECTIONS:
            if not (limits.loopback and _is_loopback(arguments[1])):
                raise PermissionError(errno.EACCES, "connections are not permitted in a run for an agent")
        elif event in _PROGRAMS:
            raise PermissionError(errno.EACCES, "programs are not permitted in a run for an agent")

    return check


def _require(path: object, folders: Iterable[str], action: str) -> None:
    """Raise PermissionError unless *path* is in one of *folders*."""
    if not isinstance(path, (str, bytes, os.PathLike)):
        return  # the number of an open file, or None for the working directory
    text = os.fsdecode(path)
    if text == os.devnull or (action == _READING and _SYSTEM.fullmatch(os.path.normpath(text))):
        return
    real = os.path.realpath(text)
    for folder in folders:
        if real == folder or real.startswith(folder.rstrip(os.sep) + os.sep):
            return
    raise PermissionError(errno.EACCES, f"{action} outside of the served folder is not permitted", text)


def _is_write(mode: object, flags: object) -> bool:
    if isinstance(mode, str):
        return any(letter in mode for letter in "wax+")
    if isinstance(flags, int):
        return bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND))
    return False


def _is_loopback(address: object) -> bool:
    return isinstance(address, tuple) and bool(address) and address[0] in _LOOPBACK


def _real_paths(paths: Iterable[str]) -> list[str]:
    return [os.path.realpath(path) for path in paths if path]


def limit_process(**limits: int) -> None:
    """Lower limits of this process for good; Windows has no such limits.

    Args:
        limits: The values by the names of the module `resource`, for example `RLIMIT_CPU=60`.
    """
    global _limited
    _limited = True
    if sys.platform == "win32":
        return
    import resource

    for name, value in limits.items():
        kind = getattr(resource, name)
        _, highest = resource.getrlimit(kind)
        least = value if highest == resource.RLIM_INFINITY else min(value, highest)
        resource.setrlimit(kind, (least, least))


def is_limited() -> bool:
    """Return whether `limit_process` was called in this process."""
    return _limited
