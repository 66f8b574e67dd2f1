"""Writing what a command makes into a file that the user names."""

from pathlib import Path

import click


def write(target: Path, data: bytes) -> None:
    """Write *data* into *target*. Raises :class:`click.ClickException` where that can't be."""
    try:
        target.write_bytes(data)
    except OSError as fault:
        raise click.ClickException(f"'{target}' can't be written: {fault.strerror}") from fault
