"""`btcore lsp`: the language server, which editors start."""

import click


@click.command(short_help="Start the language server for editors.")
def lsp() -> None:
    """Serve the Language Server Protocol over stdin and stdout, for editors.

    The editor starts this command. It reports errors and warnings while you type, completes nodes, ports
    and keys, and shows documentation. docs/guides/editors.md has the settings of editors.
    """
    from btcore.language.server import create_server

    create_server().start_io()
