"""The runs of commands with the options of providers."""

from collections.abc import Callable, Sequence
from types import TracebackType

import click

from btcore.cli import terminal
from btcore.cli.provider_command import command_providers, given_setting_options
from btcore.clock import Clock
from btcore.field_options import FieldOption
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
        settings: The settings, which the function of the command got.
        prepare: As in `Run`.
        resources: As in `Run`.
        clock: As in `Run`.
        tick_limit: As in `Run`.
    """

    def __init__(
        self,
        ctx: click.Context,
        source: Plans | TreelessProgram,
        settings: GivenSettings,
        prepare: Callable[[Run], None] | None = None,
        *,
        resources: Sequence[object] = (),
        clock: Clock | None = None,
        tick_limit: float | None = None,
    ) -> None:
        super().__init__(
            source,
            settings=settings,
            providers=command_providers(ctx).available,
            prepare=prepare,
            resources=resources,
            clock=clock,
            tick_limit=tick_limit,
        )
        self.report.print_warning = terminal.print_warning
        self._ctx = ctx

    def warn_unused(self, settings_class: type[Settings], reason: str) -> None:
        """Print a warning for the given options of a class, unless they are the command's own options."""
        own = [option.options_class for option in self._ctx.command.params if isinstance(option, FieldOption)]
        if settings_class in own:
            return
        given = [item for item in given_setting_options(self._ctx) if item.options_class is settings_class]
        names = join_names([option.opts[0] for option in given])
        terminal.print_warning(f"{names} {'has' if len(given) == 1 else 'have'} no effect: {reason}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the run, and print the `closing_errors` instead of raising them; see `exit_code`."""
        try:
            self._close(kind, error, trace)
        finally:
            for closing_error in self.closing_errors:
                terminal.print_error(str(closing_error))
