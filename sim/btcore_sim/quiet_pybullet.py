"""The physics engine, imported without the greeting that it writes to stderr."""

import os


def _hush() -> int:
    """Send stderr, the file descriptor, nowhere; return where it went before."""
    before = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    os.close(nowhere)
    return before


_stderr = _hush()
try:
    import pybullet
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)

__all__ = ["pybullet"]
