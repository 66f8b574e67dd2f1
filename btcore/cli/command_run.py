"""The run of a command: its providers come from the command line, and its problems are printed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Unpack

import click

from btcore.cli import terminal
from btcore.cli.provider_options import command_providers, given_options, settings_of
from btcore.loading.load import LoadArguments
from btcore.runs.run import Run, TreelessProgram
from btcore.runs.settings import GivenSettings, Settings
from btcore.suggestions import join_names
from btcore.xml.plan.plan import Plans


class CommandRun(Run):
    """A run of a command of class `ProviderCommand`.

    Options that no provider uses are printed, and what the providers raise when they are closed.

    Args:
        ctx: The context of the command.
        source: The tree or the program.
        prepare: As in `Run`.
        settings: Settings in place of those of the command line.
        provided: As in `Run`.
        used: Classes of settings that the command uses itself.
        option_defaults: Values of options that were not given, by the names of their parameters.
        arguments: As in `Run`.
    """

    def __init__(
        self,
        ctx: click.Context,
        source: Plans | TreelessProgram,
        prepare: Callable[[Any], None] | None = None,
        *,
        settings: Sequence[Settings] = (),
        provided: Sequence[object] = (),
        used: Iterable[type[Settings]] = (),
        option_defaults: Mapping[str, Any] | None = None,
        **arguments: Unpack[LoadArguments],
    ) -> None:
        super().__init__(
            source,
            settings=GivenSettings([*settings_of(ctx, option_defaults), *settings]),
            provided=provided,
            providers=command_providers(ctx).available,
            prepare=prepare,
            **arguments,
        )
        self._ctx = ctx
        self._used = frozenset(used)

    def warn_unused(self, unused: type[Settings], reason: str) -> None:
        """Print a warning for the given options of *unused*, unless the command uses them itself."""
        if unused in self._used:
            return
        names = [option.opts[0] for option in given_options(self._ctx) if option.struct is unused]
        have = "has" if len(names) == 1 else "have"
        terminal.print_warning(f"{join_names(names)} {have} no effect: {reason}")

    def handle_closing_errors(self, error: BaseException | None) -> None:
        """Print the errors, which also determine the exit code."""
        for closing_error in self.closing_errors:
            terminal.print_error(str(closing_error))
