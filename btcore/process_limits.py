"""Limits of this process's memory, processor time and files, where the operating system has them."""

import sys

_limited = False


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
