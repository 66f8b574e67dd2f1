"""Fixtures of the engine's regression tests: trees of mock leaves on simulated time."""

from tests.btcore.conftest import calls, clock, make_tree

__all__ = ["calls", "clock", "make_tree"]
