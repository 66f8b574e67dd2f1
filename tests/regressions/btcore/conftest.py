"""Fixtures of the engine's regression tests: trees of mock leaves on simulated time."""

from tests.btcore.conftest import clock, journal, make_tree

__all__ = ["clock", "journal", "make_tree"]
