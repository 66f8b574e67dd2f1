"""Options for output files, and writing them."""

from pathlib import Path
from typing import Final

import click

from btcore.output_files import write_file

OUTPUT_FILE: Final = click.Path(dir_okay=False, path_type=Path)
"""The type of an option that names a file to write."""


def write(target: Path, data: bytes) -> None:
    """Write *data* to the file *target*, which is overwritten if it exists."""
    try:
        write_file(target, data)
    except OSError as error:
        raise click.ClickException(f"cannot write '{target}': {error.strerror}") from error
