"""The fixtures of the logs of the core."""

from tests.btcore.logs.conftest import captures, collect, sample, small

__all__ = ["captures", "collect", "sample", "small"]
