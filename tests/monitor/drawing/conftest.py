"""The fixture that calls the command line."""

from tests.btcore.cli.conftest import cli

__all__ = ["cli"]
