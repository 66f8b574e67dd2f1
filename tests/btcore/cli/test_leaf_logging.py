"""The log messages of leaves are printed on stderr during a run, each on its own line."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from rich.console import Console

from btcore.cli.progress import log_to_console

LOGGER = logging.getLogger("some.leaf")
WARNING, ERROR, INFO = logging.WARNING, logging.ERROR, logging.INFO


@contextmanager
def bare_logging(*handlers: logging.Handler) -> Iterator[logging.Logger]:
    """Set up logging as in a program that configures only *handlers*."""
    root = logging.getLogger()
    before, root.handlers = root.handlers, list(handlers)
    try:
        yield root
    finally:
        root.handlers = before


@pytest.mark.parametrize(
    ("level", "line"), [(WARNING, "warning: [red] has 3 %\n"), (ERROR, "error: [red] has 3 %\n"), (INFO, "")]
)
def test_warning_is_printed_with_level_in_front(
    capsys: pytest.CaptureFixture[str], level: int, line: str
) -> None:
    with bare_logging(), log_to_console(Console(stderr=True, highlight=False)):
        LOGGER.log(level, "%s has %d %%", "[red]", 3)
    assert capsys.readouterr().err == line


def test_handlers_are_removed_afterwards() -> None:
    with bare_logging() as root:
        with log_to_console(Console(stderr=True)):
            assert len(root.handlers) == 1
        assert root.handlers == []


def test_logging_set_up_by_the_program_is_not_changed(capsys: pytest.CaptureFixture[str]) -> None:
    own = logging.NullHandler()
    with bare_logging(own) as root, log_to_console(Console(stderr=True)):
        LOGGER.warning("it rains")
        assert root.handlers == [own]
    assert capsys.readouterr().err == ""
