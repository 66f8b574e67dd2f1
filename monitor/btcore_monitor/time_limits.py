"""How long a run waits for its clients, and `btcore monitor` for its viewer (s, wall clock)."""

from typing import Final

VIEWER_START_TIMEOUT_S: Final = 300.0
"""Until a viewer listens after its start, which is slow on a busy machine. A viewer that ends is noticed."""

FLUSH_TIMEOUT_S: Final = 20.0
"""Until the viewer and the file of a recording have received its remaining data."""

CONNECT_TIMEOUT_S: Final = VIEWER_START_TIMEOUT_S + 30.0
"""Until a `btcore monitor` has opened its viewer and connected. A process that ends is noticed at once."""

SHOW_TIMEOUT_S: Final = FLUSH_TIMEOUT_S + 10.0
"""Until a `btcore monitor` has received the remaining data, passed them to its viewer, and ended."""

WRITE_TIMEOUT_S: Final = FLUSH_TIMEOUT_S + 40.0
"""The same of a `btcore monitor` that writes a recording, which must not be cut off."""

PICTURE_TIMEOUT_S: Final = VIEWER_START_TIMEOUT_S + 600.0
"""Further time of a `btcore monitor` that then opens another viewer and draws a picture."""

GRACE_S: Final = 30.0
"""The time limit until foreign clients have received the end of the stream. A client that reads gets it at
once, but on a busy machine it may need many seconds."""

INTERRUPTED_GRACE_S: Final = 2.0
"""The time limit for the same after Ctrl-C, or after an exception of the program. Under `btcore run`, GRACE_S
applies after an exception of a leaf."""
