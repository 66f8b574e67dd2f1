"""The import of PyBullet without the build banner that it writes to stderr.

The banner is written by C code, so that redirecting `sys.stderr` does not suppress it.
"""

import os
from pathlib import Path

_stderr = os.dup(2)
with Path(os.devnull).open("wb") as _null:
    os.dup2(_null.fileno(), 2)
try:
    import pybullet
finally:
    os.dup2(_stderr, 2)
    os.close(_stderr)

__all__ = ["pybullet"]
