"""The server of these tests is also that of the acceptance script."""

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
    """The server whose behavior is part of each goal, in another process."""
    from planned_server import planned_server

    with planned_server() as process:
        yield process
