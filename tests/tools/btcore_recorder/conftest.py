"""The fixtures of the tests of logs: recorded files and their tree, and a small tree."""

from tests.btcore.logs.conftest import captures, sample, small

__all__ = ["captures", "sample", "small"]
