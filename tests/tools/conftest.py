"""The fixtures of the engine and of the command line, for the tests of the tools."""

from tests.btcore.cli.conftest import cli, last_json, library, tree_file
from tests.btcore.conftest import calls, clock, make_tree

__all__ = ["calls", "cli", "clock", "last_json", "library", "make_tree", "tree_file"]
