"""`btcore lsp`: the language server, which editors start."""

import gc
import os

import click


@click.command(short_help="Start the language server for editors.")
# Several editors add this argument to the command of any server.
@click.option("--stdio", is_flag=True, hidden=True, expose_value=False)
def lsp() -> None:
    """Serve the Language Server Protocol over stdin and stdout, for editors.

    The editor starts this command. It reports errors and warnings while you type, completes nodes, ports
    and keys, and shows documentation. docs/guides/editors.md has the settings of editors.
    """
    from btcore.language.server import create_server

    # A large document has more than 100,000 objects, which live until its next change. With Python's default,
    # the garbage collector would take half of the time of each request.
    gc.set_threshold(100_000)
    # The server closes its streams. Whatever else is printed must not be among its messages.
    stdin, stdout = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    create_server().start_io(stdin, stdout)
