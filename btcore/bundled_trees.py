"""The trees that are bundled with btcore, by name."""

import os
from pathlib import Path

from btcore.errors import BtcoreError
from btcore.input_files import data_folder
from btcore.suggestions import did_you_mean, join_names


def folder() -> Path:
    """Return the folder of the bundled trees."""
    return data_folder("trees")


def names() -> list[str]:
    """Return the names of the bundled trees: `bumpgo`, `patrolling` …

    Examples:
        >>> from btcore import bundled_trees
        >>> "bumpgo" in bundled_trees.names()
        True
    """
    here = folder()
    return sorted(path.relative_to(here).with_suffix("").as_posix() for path in here.rglob("*.xml"))


def find(name: str) -> Path:
    """Return the file for *name*, which is the path of a file or one of `names`.

    Raises:
        BtcoreError: There is no such file or tree; the message suggests the nearest name.

    Examples:
        >>> from btcore import bundled_trees
        >>> bundled_trees.find("bumpgo").name
        'bumpgo.xml'
    """
    path = Path(name)
    # Reading the file reports links that form a loop, devices and the like.
    if os.path.lexists(path) and not path.is_dir():
        return path
    if path.suffix != ".xml" and name in names():
        return folder() / f"{name}.xml"
    if path.is_dir():
        raise BtcoreError(f"'{name}' is a folder; give the path of a file.")
    raise BtcoreError(_missing_message(path, name))


def _missing_message(path: Path, name: str) -> str:
    if path.suffix == ".xml" or path.parent != Path():
        siblings = [str(other) for other in path.parent.glob("*.xml")] if path.parent.is_dir() else []
        hint = did_you_mean(name, siblings)
        text = f"there is no file '{name}'"
    else:
        hint = did_you_mean(name, names())
        text = f"there is neither a file nor a tree '{name}'"
    return text + (hint or (f"; bundled trees: {join_names(names())}" if names() else ""))
