"""The run of a command: its providers come from the command line, and its problems are printed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any, Self, Unpack

import click

from btcore.cli import terminal
from btcore.cli.provider_options import available_providers, settings_of
from btcore.loading.load import LoadOptions
from btcore.runs.choice import explain_unused
from btcore.runs.providers import OutputError
from btcore.runs.run import Run, TreelessProgram
from btcore.runs.settings import RunSettings, Settings
from btcore.xml.models.stubs import StubResults
from btcore.xml.plan.plan import Plans


class CommandRun(Run):
    """A run of a command of class `ProviderCommand`.

    On entry, it prints a warning for options that no provider uses; on exit, it prints the error of an
    incomplete output.

    Args:
        ctx: The context of the command.
        source: The tree or the program.
        prepare: As in `Run`.
        settings: Settings in place of those of the command line.
        provided: As in `Run`.
        used: Classes of settings that the command uses itself.
        option_defaults: Values of options that were not given, by the names of their parameters.
        stubs: As in `Run`.
        options: As in `Run`.
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
        stubs: StubResults | None = None,
        **options: Unpack[LoadOptions],
    ) -> None:
        replaced = {type(one) for one in settings}
        chosen = [*(one for one in settings_of(ctx, option_defaults) if type(one) not in replaced), *settings]
        super().__init__(
            source,
            settings=chosen,
            provided=provided,
            stubs=stubs,
            prepare=prepare,
            source_of_providers=available_providers(ctx).source,
            **options,
        )
        self._used: list[type[Settings]] = [RunSettings, *used]

    def __enter__(self) -> Self:
        super().__enter__()
        for sentence in explain_unused(self.choice, self.providers, self.settings, self._used):
            terminal.print_warning(sentence)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        try:
            return super().__exit__(kind, error, trace)
        except OutputError as incomplete:
            self.is_output_incomplete = True
            terminal.print_error(str(incomplete))
            return None
