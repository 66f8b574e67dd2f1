"""The fixtures of the tests of logs: recorded files, and a small tree."""

from tests.btcore.logs.conftest import captures, small

__all__ = ["captures", "small"]
