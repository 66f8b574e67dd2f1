"""`btcore preview`: show a tree in a browser, follow its file, and watch the running tree."""

import threading
import webbrowser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click

from btcore.cli import terminal
from btcore.cli.node_libraries import load_libraries
from btcore.cli.tree_source import STDIN, TreeOptions, complete_tree, find_source
from btcore.clock import POLL_INTERVAL_S
from btcore.exit_codes import code_of_signal
from btcore.field_options import ExtensibleCommand, pass_options
from btcore.loading.hot_reload import FileWatcher
from btcore.signals import EndingSignals
from btcore_studio.language.live import LiveExtension
from btcore_studio.pages.timeline import open_timeline
from btcore_studio.preview.server import PreviewServer
from btcore_studio.preview.session import PreviewSession
from btcore_studio.preview.tree_reading import RecordedTree, TreeFile


@click.command(
    cls=ExtensibleCommand, group="btcore.preview", short_help="Show a tree in a browser, and watch it run."
)
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@pass_options(TreeOptions, "options")
@click.option(
    "--http-port",
    type=click.IntRange(0, 65535),
    default=0,
    metavar="PORT",
    help="The port of the page on 127.0.0.1; by default a free port.",
)
@click.option("--open/--no-open", "opens", default=True, help="Open the page in the browser, or do not.")
@click.option("--json", "as_json", is_flag=True, help="Print the address of the page as a JSON object.")
@click.pass_context
def preview(
    ctx: click.Context,
    /,
    source: str,
    options: TreeOptions,
    http_port: int,
    opens: bool,
    as_json: bool,
    **extension_values: Any,
) -> int:
    """Serve a page with a drawing of TREE on this machine, until Ctrl-C.

    The page follows the saved file, shows its errors, and connects with the running tree. Its address
    contains a secret token, without which the page cannot be opened.

    TREE is an XML file, or the name of a tree that is bundled with btcore. It may also be a recording
    (.btrec.txt or .mcap) of a run: the page then has a timeline, and shows the run at any moment.
    """
    path = find_source(source)
    if path == STDIN:
        raise click.UsageError("btcore preview needs a file: a tree on stdin cannot be saved again.")
    assert isinstance(ctx.command, ExtensibleCommand)
    live: LiveExtension | None = ctx.command.create_extension(extension_values)
    file_watcher = None
    timeline = open_timeline(path)
    if timeline is not None:
        if live is not None and live.address:
            raise click.UsageError(f"{path} is a recording, so there is no running tree to watch.")
        session = PreviewSession(RecordedTree(path, timeline.plans), None, timeline)
    else:
        file_watcher = FileWatcher(path, options.confined)
        nodes_for = load_libraries(options.plugins, options.models, options.confined).nodes_for
        file = TreeFile(path, nodes_for, options.tree, options.format, options.confined)
        session = PreviewSession(file, None if live is None else live.connect)
    try:
        server = PreviewServer(session, http_port)
    except OSError as error:
        raise click.ClickException(f"cannot listen on port {http_port}: {error.strerror}") from None
    stop = threading.Event()
    with server, EndingSignals(stop.set) as signals, TemporaryDirectory() as folder:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            if live is not None and live.address:
                session.watch(live.address)
            if as_json:
                terminal.print_json({"url": server.url})
            else:
                click.echo(f"{path} is shown at {server.url} (Ctrl-C ends the preview)")
            if opens and not as_json:
                _open_page(server.url, Path(folder))
            while not stop.wait(POLL_INTERVAL_S):
                if file_watcher is not None and file_watcher.take_save():
                    session.reload()
        finally:
            session.close()
            server.shutdown()
    return code_of_signal(signals.number)


def _open_page(url: str, folder: Path) -> None:
    """Open the page in the browser by a file in *folder*, which only the user can read.

    Other users could read the token in the arguments of the browser's process.
    """
    redirection = folder / "preview.html"
    redirection.write_bytes(f'<!doctype html><meta http-equiv="refresh" content="0;url={url}">'.encode())
    webbrowser.open(redirection.as_uri())
