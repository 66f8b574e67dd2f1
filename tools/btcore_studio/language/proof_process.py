"""The process of a search: it gets a request as a line of JSON, and writes its progress and the answers.

It imports no code of users: leaves are known by their models.
"""

import math
import os
import sys
import time
from typing import Any, Final

import msgspec

from btcore.errors import BtcoreError
from btcore_studio.language.proofs import SearchRequest, search

_INTERVAL_S: Final = 0.2
"""Minimum time (s) between two messages about the progress."""


def main() -> None:
    """Answer the request on stdin on stdout."""
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # nothing else writes to the output
    reported = -math.inf

    def send(data: dict[str, Any]) -> None:
        output.write(msgspec.json.encode(data) + b"\n")
        output.flush()

    def report(*numbers: int) -> None:
        nonlocal reported
        if time.monotonic() - reported > _INTERVAL_S:
            reported = time.monotonic()
            send({"progress": numbers})

    request = msgspec.json.decode(sys.stdin.buffer.readline(), type=SearchRequest)
    try:
        send({"found": search(request.project(), request.params, report)})
    except BtcoreError as error:
        send({"error": str(error)})


if __name__ == "__main__":
    main()
