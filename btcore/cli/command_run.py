"""The runs of commands with the options of providers."""

from collections.abc import Callable, Sequence

import click

from btcore.cli import terminal
from btcore.cli.provider_command import command_providers, given_setting_options
from btcore.clock import Clock
from btcore.errors import BtcoreError
from btcore.field_options import FieldOption
from btcore.runs.run import Run, TreelessProgram
from btcore.runs.settings import GivenSettings, Settings
from btcore.suggestions import join_names
from btcore.xml.plan.plan import Plans


def create_run(
    ctx: click.Context,
    source: Plans | TreelessProgram,
    settings: GivenSettings,
    prepare: Callable[[Run], None] | None = None,
    *,
    resources: Sequence[object] = (),
    clock: Clock | None = None,
    tick_limit: float | None = None,
) -> Run:
    """Return the run of a command of class `ProviderCommand`, which prints its warnings and closing errors.

    Args:
        ctx: The context of the command.
        source: The tree or the program.
        settings: The settings, which the function of the command got.
        prepare: As in `Run`.
        resources: As in `Run`.
        clock: As in `Run`.
        tick_limit: As in `Run`.
    """
    return Run(
        source,
        settings=settings,
        providers=command_providers(ctx).available,
        prepare=prepare,
        resources=resources,
        clock=clock,
        tick_limit=tick_limit,
        printer=_CommandPrinter(ctx),
    )


class _CommandPrinter:
    """Prints the messages of a command's run, with the names of its options."""

    def __init__(self, ctx: click.Context) -> None:
        self._ctx = ctx

    def print_warning(self, message: str) -> None:
        terminal.print_warning(message)

    def print_error(self, error: BtcoreError) -> None:
        terminal.print_error(str(error))

    def print_unused(self, settings_class: type[Settings], reason: str) -> None:
        own = [option.options_class for option in self._ctx.command.params if isinstance(option, FieldOption)]
        if settings_class in own:
            return  # the command may use its own options
        given = [item for item in given_setting_options(self._ctx) if item.options_class is settings_class]
        names = join_names([option.opts[0] for option in given])
        terminal.print_warning(f"{names} {'has' if len(given) == 1 else 'have'} no effect: {reason}")
