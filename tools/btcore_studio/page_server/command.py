"""`btcore studio`: edit trees in a browser, and watch them run."""

import asyncio
import gc
import logging
import os
import posixpath
import shutil
import threading
import webbrowser
from collections.abc import Callable
from contextlib import AsyncExitStack
from importlib.resources.abc import Traversable
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Annotated, Any

import click
from click.core import ParameterSource

from btcore import bundled_trees
from btcore.cli import terminal
from btcore.cli.node_libraries import LibraryOptions
from btcore.cli.tree_source import STDIN, complete_tree, complete_tree_id, find_source
from btcore.exit_codes import ExitCode, code_of_signal
from btcore.field_options import ExtensibleCommand, pass_options
from btcore.input_files import read_error, read_file, real_path
from btcore.options import option
from btcore.signals import EndingSignals
from btcore.xml.plan.plan import Plans

if TYPE_CHECKING:
    from btcore_studio.language.live import LiveExtension
    from btcore_studio.page_server.session import Shown, StudioSession


_LOGS = (".btlog", ".db3")


class StudioOptions(LibraryOptions):
    """The options that select what the studio shows."""

    tree: (
        Annotated[
            str,
            option(
                "Show this tree of the file first instead of its main tree.",
                metavar="ID",
                complete=complete_tree_id,
            ),
        ]
        | None
    ) = None
    read_only: Annotated[bool, option("Change and write no file.")] = False
    trust: Annotated[
        bool,
        option("Let pages run trees with their real leaves, in processes. --plugin implies it."),
    ] = False


@click.command(cls=ExtensibleCommand, group="btcore.live")
@click.argument("source", metavar="[SOURCE]", default=".", shell_complete=complete_tree)
@pass_options(StudioOptions, "options")
@click.option(
    "--compare",
    nargs=2,
    metavar="OLD NEW",
    shell_complete=complete_tree,
    help="Show two versions of a file side by side, until the page is closed.",
)
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
def studio(
    ctx: click.Context,
    /,
    source: str,
    options: StudioOptions,
    compare: tuple[str, str] | None,
    http_port: int,
    opens: bool,
    as_json: bool,
    **extension_values: Any,
) -> int:
    """Serve a page that draws and edits trees on this machine, until Ctrl-C.

    SOURCE is a folder, an XML file, a project of Groot 2 (.btproj), or the name of a tree that is bundled
    with btcore; by default the current folder. The page writes only .xml and .btproj files of that folder, or
    of the folder of the file. Bundled trees are read-only. SOURCE may also be a recording (.btrec.txt or
    .mcap) of a run: the page then has a timeline, and shows the run at any moment.

    With --compare, the page shows what was added, removed, moved and changed between two versions of a file,
    and writes nothing. One of them can be /dev/null. For `git difftool --extcmd 'btcore studio --compare'`,
    the command ends when the page is closed.

    The address of the page contains a secret token, without which the page cannot be opened. The page also
    connects with running trees. Python code is imported only from installed libraries and from --plugin.
    """
    # The extra is imported only here, so that --help works without it.
    from btcore_studio.language.server import GC_THRESHOLD
    from btcore_studio.page_server.server import built_page
    from btcore_studio.page_server.session import StudioSession

    page = built_page()
    if page is None:
        raise click.ClickException("the page is not built; in a checkout of btcore, build it with: make page")
    assert isinstance(ctx.command, ExtensibleCommand)
    live = ctx.command.create_extension(extension_values)
    gc.set_threshold(GC_THRESHOLD)
    gc.freeze()  # so that collections skip the imported modules
    # Whatever a page sends is answered with an error, and needs no log.
    logging.getLogger("pygls").addHandler(logging.NullHandler())
    # For what must not be lost: only this user can read it.
    folder = Path(mkdtemp(prefix="btcore-studio-"))
    try:
        if compare is None:
            shown = find_shown(source, options, live, folder / "recording")
            title, end = source, "Ctrl-C ends the studio"
        else:
            if ctx.get_parameter_source("source") is not ParameterSource.DEFAULT:
                raise click.UsageError("--compare takes two files, and no SOURCE.")
            shown = find_versions(compare, options, live, folder / "empty")
            title, end = " and ".join(compare), "close the page, or press Ctrl-C, to end the comparison"
        session = StudioSession(shown, folder)

        def show(url: str) -> None:
            if as_json:
                terminal.print_json({"url": url})
                return
            click.echo(f"{title} {'is' if compare is None else 'are'} shown at {url} ({end})")
            if opens:
                _open_page(url, folder)

        with EndingSignals() as signals:
            asyncio.run(_serve(session, http_port, page, signals, show))
        _keep_unsaved(session, folder)
    finally:
        if not (folder / "unsaved").exists():
            shutil.rmtree(folder, ignore_errors=True)
    return code_of_signal(signals.number) if signals.number else ExitCode.SUCCESS


async def _serve(
    session: "StudioSession",
    port: int,
    page: Traversable,
    signals: EndingSignals,
    show: Callable[[str], None],
) -> None:
    """Serve pages until the first signal, or the end of a comparison."""
    from btcore_studio.page_server.server import StudioServer

    loop = asyncio.get_running_loop()
    signals.stop = lambda: loop.call_soon_threadsafe(session.ended.set)
    async with AsyncExitStack() as opened:
        await opened.enter_async_context(session)
        try:
            server = await opened.enter_async_context(StudioServer(session, port, page))
        except OSError as error:
            raise click.ClickException(f"cannot listen on port {port}: {error.strerror}") from None
        show(server.url)
        await session.ended.wait()


def find_shown(source: str, options: StudioOptions, live: "LiveExtension | None", recording: Path) -> "Shown":
    """Return what is shown for the argument of the command.

    Args:
        live: Connects pages with running trees.
        recording: A folder to create for the documents of a recording.
    """
    from btcore_studio.language.project import SUFFIXES
    from btcore_studio.language.timeline import RecordedRun, open_timeline
    from btcore_studio.page_server.session import Shown

    plugins, models = _libraries(options)
    if Path(source).is_dir():
        folder = Path(source)
        return Shown(
            folder,
            None,
            options.tree,
            options.read_only,
            plugins,
            models,
            live=live,
            trusts_leaves=options.trust,
        )
    path = find_source(source)
    if path == STDIN:
        raise click.UsageError("btcore studio needs a file: a tree on stdin cannot be saved again.")
    timeline = open_timeline(path)
    if timeline is not None:
        if live is not None and live.address:
            raise click.UsageError(f"{path} is a recording, so there is no running tree to watch.")
        main, recorded_models = _write_documents(timeline.plans, recording)
        models += recorded_models
        return Shown(recording, main, options.tree, True, plugins, models, RecordedRun(timeline))
    if path.suffix.lower() in _LOGS:
        raise click.UsageError(
            f"'{path}' is a log: write it as a recording first, with "
            f"`btcore replay {path} --save-recording {path.stem}.btrec.txt`."
        )
    if path.suffix.lower() not in SUFFIXES:
        raise click.UsageError(f"'{path}' has no trees: its name must end with {' or '.join(SUFFIXES)}.")
    is_bundled = path.is_relative_to(bundled_trees.folder()) and not Path(source).exists()
    file = real_path(path)
    is_read_only = options.read_only or is_bundled
    return Shown(
        file.parent, file, options.tree, is_read_only, plugins, models, live=live, trusts_leaves=options.trust
    )


def find_versions(
    names: tuple[str, str], options: StudioOptions, live: "LiveExtension | None", folder: Path
) -> "Shown":
    """Return the two versions that `--compare` names.

    Args:
        live: Connects pages with running trees, but not the page of a comparison.
        folder: A folder to create, which stays empty: the page can request no files.
    """
    from btcore_studio.language.project import SUFFIXES
    from btcore_studio.page_server.session import Shown, Version

    if live is not None and live.address:
        raise click.UsageError("--compare shows files, so there is no running tree to watch.")
    versions: list[Version] = []
    for name in names:
        # Git names this file if there is none, on every system.
        if Path(name) == Path("/", "dev", "null") or name == os.devnull:
            versions.append(Version("", None))
            continue
        if Path(name).is_dir():
            raise click.UsageError(f"'{name}' is a folder: compare two files.")
        path = find_source(name)
        if path == STDIN:
            raise click.UsageError("--compare needs files, not stdin.")
        if path.suffix.lower() not in SUFFIXES:
            raise click.UsageError(f"'{path}' has no trees: its name must end with {' or '.join(SUFFIXES)}.")
        try:
            read_file(path).decode("utf-8-sig")
        except OSError as error:
            raise click.ClickException(f"'{path}' can't be read: {read_error(error)}") from None
        except UnicodeDecodeError:
            raise click.ClickException(f"'{path}' is not UTF-8") from None
        versions.append(Version(name, real_path(path)))
    folder.mkdir()
    plugins, models = _libraries(options)
    old, new = versions
    return Shown(folder, None, options.tree, True, plugins, models, versions=(old, new))


def _libraries(options: StudioOptions) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the node libraries and the model files, which the page's language server imports and reads."""
    plugins = tuple(str(Path(name).absolute()) if name.endswith(".py") else name for name in options.plugins)
    return plugins, tuple(str(path.absolute()) for path in options.models)


def _write_documents(plans: Plans, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Write the documents of a recorded tree below *folder*.

    Returns:
        The file of the main document, and the files with models, which are the models of the whole run.
    """
    from btcore_studio.language.project import SUFFIXES

    documents = plans.definitions.sources.documents
    # A recording may come from a stranger, and from a machine with other folders.
    places = [
        posixpath.normpath(
            posixpath.join("/recorded/tree", document.file.replace("\\", "/").replace(":", ""))
        )
        for document in documents
    ]
    common = posixpath.commonpath([posixpath.dirname(place) for place in places])
    files: list[Path] = []
    for document, place in zip(documents, places, strict=True):
        file = folder / posixpath.relpath(place, common)
        file = file if file.suffix in SUFFIXES else file / "tree.xml"
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(document.text.encode())
        except (OSError, ValueError) as error:
            reason = read_error(error) if isinstance(error, OSError) else str(error)
            raise click.ClickException(f"the recorded tree can't be written: {reason}") from None
        files.append(file)
    models = [
        str(real_path(file))
        for document, file in zip(documents, files, strict=True)
        if next(document.root.iterchildren("TreeNodesModel"), None) is not None
    ]
    return real_path(files[-1]), tuple(models)  # the main document is the last


def _keep_unsaved(session: "StudioSession", folder: Path) -> None:
    """Keep the unsaved changes of the pages in *folder*, and report where."""
    for number, (name, data) in enumerate(session.files.unsaved(), 1):
        kept = folder / "unsaved" / f"{number}-{name}"
        kept.parent.mkdir(exist_ok=True)
        kept.write_bytes(data)
        terminal.print_warning(f"{name} has unsaved changes, which are kept in {kept}")


def _open_page(url: str, folder: Path) -> None:
    """Open the page in the browser by a file in *folder*, which only the user can read.

    Other users could read the token in the arguments of the browser's process.
    """
    redirection = folder / "studio.html"
    redirection.write_bytes(f'<!doctype html><meta http-equiv="refresh" content="0;url={url}">'.encode())
    # A browser in the terminal would be waited for.
    threading.Thread(target=webbrowser.open, args=(redirection.as_uri(),), daemon=True).start()
