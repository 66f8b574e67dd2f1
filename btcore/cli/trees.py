"""Trees by name: the files that come with the project, found from any folder."""

from pathlib import Path

import click

import btcore
from btcore.suggestions import join_names, nearest_name

tree_option = click.option("--tree", metavar="ID", help="Which of the file's trees; default: its main one.")
format_option = click.option(
    "--format",
    type=click.Choice(["3", "4"]),
    callback=lambda ctx, option, value: None if value is None else int(value),
    help="The format of the XML; default: what its BTCPP_format says, without one 3.",
)


def folder() -> Path:
    """Where the project's own trees lie: inside the package when installed, beside it in a checkout."""
    package = Path(btcore.__file__).parent
    installed = package / "trees"
    return installed if installed.is_dir() else package.parent / "trees"


def names() -> list[str]:
    """The names that stand for a tree of the project: ``bumpgo``, ``navigation/patrol`` …"""
    here = folder()
    return sorted(path.relative_to(here).with_suffix("").as_posix() for path in here.rglob("*.xml"))


def find(name: str) -> Path:
    """The file that *name* means: a file's path, or one of :func:`names`.

    Raises :class:`click.UsageError`, with the nearest name, when there is neither.
    """
    path = Path(name)
    if path.is_file():
        return path
    if path.suffix != ".xml":
        own = folder() / f"{name}.xml"
        if name in names():
            return own
    if path.is_dir():
        raise click.UsageError(f"'{name}' is a folder; name one of its files.")
    raise click.UsageError(_nothing_there(path, name))


def _nothing_there(path: Path, name: str) -> str:
    """The sentence for a *name* that means nothing, with what was probably meant."""
    if path.suffix == ".xml" or path.parent != Path():
        beside = [str(other) for other in path.parent.glob("*.xml")] if path.parent.is_dir() else []
        meant = nearest_name(name, beside)
        text = f"there is no file '{name}'."
    else:
        meant = nearest_name(name, names())
        text = f"there is neither a file nor a tree '{name}'."
    if meant is not None:
        return f"{text} Did you mean '{meant}'?"
    return f"{text} The trees that have a name: {join_names(names())}." if names() else text
