"""Writing a command's output to a file."""

from pathlib import Path

import click


def write(target: Path, data: bytes) -> None:
    """Write *data* to the file *target*.

    Args:
        target: The file; it is overwritten if it exists.
        data: The new content.

    Raises:
        click.ClickException: The file cannot be written.
    """
    try:
        target.write_bytes(data)
    except OSError as error:
        raise click.ClickException(f"cannot write '{target}': {error.strerror}") from error
