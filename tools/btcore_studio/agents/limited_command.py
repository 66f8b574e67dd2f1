"""`btcore` in a process with limits of the operating system: `python -m … DATA FILE SECONDS [ARGUMENT]…`.

On Linux, the process can write files in its working directory only. The processes that the command starts
have the limits, too. Windows has none.
"""

import ctypes
import os
import struct
import sys
from typing import Final

from btcore.__main__ import main

# System calls of Landlock (https://docs.kernel.org/userspace-api/landlock.html), equal on all architectures.
_CREATE_RULESET: Final = 444
_ADD_RULE: Final = 445
_RESTRICT_SELF: Final = 446
_GET_VERSION: Final = 1
_RULE_OF_FOLDER: Final = 1
_NO_NEW_PRIVILEGES: Final = 38
# Writing, and creating and removing files of all types; moving and truncating since the versions 2 and 3.
_WRITING: Final = 1 << 1 | sum(1 << bit for bit in range(4, 13))
_WRITING_SINCE: Final = {2: 1 << 13, 3: 1 << 14}


def _limit_process(data: int, file: int, seconds: int) -> None:
    """Limit the data of this process, each file that it writes (bytes), and its processor time (s)."""
    if sys.platform == "win32":
        return
    import resource

    limits = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_CPU: seconds,
        resource.RLIMIT_DATA: data,
        resource.RLIMIT_FSIZE: file,
    }
    for limit, value in limits.items():
        highest = resource.getrlimit(limit)[1]
        least = value if highest == resource.RLIM_INFINITY else min(value, highest)
        resource.setrlimit(limit, (least, least))
    _write_only_in(".", "/dev")


def landlock_version() -> int:
    """Return the version of Landlock that the kernel has; 0 = none."""
    if sys.platform != "linux":
        return 0
    version: int = ctypes.CDLL(None).syscall(_CREATE_RULESET, None, 0, _GET_VERSION)
    return max(0, version)


def _write_only_in(*folders: str) -> None:
    """Let this process write files in *folders* only. A kernel without Landlock does not restrict it."""
    version = landlock_version()
    if sys.platform != "linux" or not version:
        return
    libc = ctypes.CDLL(None, use_errno=True)

    def call(function: str, *arguments: object) -> int:
        result: int = getattr(libc, function)(*arguments)
        if result < 0:
            code = ctypes.get_errno()
            raise OSError(code, f"cannot limit where the command writes: {os.strerror(code)}")
        return result

    handled = _WRITING | sum(access for since, access in _WRITING_SINCE.items() if since <= version)
    rules = call("syscall", _CREATE_RULESET, struct.pack("=Q", handled), 8, 0)
    for folder in folders:
        opened = os.open(folder, os.O_PATH)
        call("syscall", _ADD_RULE, rules, _RULE_OF_FOLDER, struct.pack("=Qi", handled, opened), 0)
        os.close(opened)
    call("prctl", _NO_NEW_PRIVILEGES, 1, 0, 0, 0)
    call("syscall", _RESTRICT_SELF, rules, 0)
    os.close(rules)


if __name__ == "__main__":
    _limit_process(*map(int, sys.argv[1:4]))
    del sys.argv[1:4]
    main()
