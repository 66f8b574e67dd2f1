"""Shell completion of the names of worlds."""

import click
from click.shell_completion import CompletionItem

from btcore_sim.random_world_kinds import KINDS


def complete_world(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the worlds that begin with *incomplete*; if there is none, the shell completes a file."""
    from btcore_sim.world_description import world_names

    random_worlds = (f"{kind}:" for kind in KINDS)
    names = [name for name in (*world_names(), *random_worlds) if name.startswith(incomplete)]
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]
