"""Shell completion of the names of worlds."""

import click
from click.shell_completion import CompletionItem


def complete_world(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the worlds that begin with *incomplete*; if there is none, the shell completes a file."""
    from btcore_sim.scene import scene_names

    names = [name for name in (*scene_names(), "office:", "home:") if name.startswith(incomplete)]
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]
