"""Check whether this machine can open a window."""

import os
import sys


def has_display() -> bool:
    """Return whether a window can be opened on this machine."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
