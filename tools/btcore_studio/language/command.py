"""`btcore lsp`: the language server, which editors start."""

import gc
import os

import click


@click.command()
# Several editors add this argument to the command of any server.
@click.option("--stdio", is_flag=True, hidden=True, expose_value=False)
def lsp() -> int:
    """Serve the Language Server Protocol over stdin and stdout, for editors.

    The editor starts this command. It reports errors and warnings while you type, completes nodes, ports
    and keys, and shows documentation. docs/guides/editors.md has the settings of editors.
    """
    from btcore_studio.language.server import GC_THRESHOLD, create_server

    gc.set_threshold(GC_THRESHOLD)
    gc.freeze()  # so that collections skip the imported modules
    # The server closes its streams. Whatever else is printed must not be among its messages.
    stdin, stdout = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    server = create_server()
    server.start_io(stdin, stdout)
    # The protocol requires 1 for an end without the request `shutdown`. pygls ends without an exit code.
    return 0 if server.was_shut_down else 1
