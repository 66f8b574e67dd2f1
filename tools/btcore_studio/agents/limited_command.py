"""`btcore` in a process with limits of the operating system: `python -m … DATA FILE SECONDS [ARGUMENT]…`.

The processes that the command starts have the limits, too. Windows has none.
"""

import sys

from btcore.__main__ import main


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
    for kind, value in limits.items():
        highest = resource.getrlimit(kind)[1]
        least = value if highest == resource.RLIM_INFINITY else min(value, highest)
        resource.setrlimit(kind, (least, least))


if __name__ == "__main__":
    _limit_process(*map(int, sys.argv[1:4]))
    del sys.argv[1:4]
    main()
