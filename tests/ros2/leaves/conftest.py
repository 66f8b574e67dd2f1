"""The server of these tests, which an acceptance script also uses."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "acceptance"))

if TYPE_CHECKING:
    from planned_server import ServerProcess


@pytest.fixture(scope="module")
def server() -> "Iterator[ServerProcess]":
    """A server in another process; each goal determines what the server does."""
    from planned_server import start_planned_server

    with start_planned_server() as process:
        yield process
