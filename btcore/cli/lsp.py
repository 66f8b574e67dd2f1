"""`btcore lsp`: the language server, which editors start."""

import os

import click


@click.command(short_help="Start the language server for editors.")
def lsp() -> None:
    """Serve the Language Server Protocol over stdin and stdout, for editors.

    The editor starts this command. It reports errors and warnings while you type, completes nodes, ports
    and keys, and shows documentation. docs/guides/editors.md has the settings of editors.
    """
    from btcore.language.server import create_server

    # The server closes its streams. Whatever else is printed must not be among its messages.
    stdin, stdout = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    create_server().start_io(stdin, stdout)
