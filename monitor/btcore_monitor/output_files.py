"""Check the files that options name, before a command starts to write them."""

from pathlib import Path

from btcore.errors import SettingsError


def check_is_recording(save: Path) -> None:
    """Raise SettingsError if the file of `--save` does not have the suffix `.rrd`."""
    if save.suffix.lower() != ".rrd":
        raise SettingsError(f"--save {save}: a recording is an .rrd file: --save {save.with_suffix('.rrd')}")


def check_folder(option: str, path: Path) -> None:
    """Raise SettingsError if the folder of *option*'s file does not exist."""
    if not path.resolve().parent.is_dir():
        raise SettingsError(f"{option} {path}: there is no folder {path.resolve().parent}")


def check_writable(option: str, path: Path) -> None:
    """Raise SettingsError if *option*'s file cannot be written; an existing file is not changed."""
    check_folder(option, path)
    is_new = not path.exists()
    try:
        with path.open("ab"):
            pass
        if is_new:
            path.unlink()
    except OSError as error:
        raise SettingsError(f"{option} {path}: it can't be written: {error.strerror or error}") from None
