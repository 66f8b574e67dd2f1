"""The import of PyBullet without the build banner that it writes to stderr.

The banner is written by C code, so that redirecting `sys.stderr` does not suppress it.
"""

import os


def _hush() -> int:
    """Redirect file descriptor 2 (stderr) to the null device; return a duplicate of the old descriptor."""
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
