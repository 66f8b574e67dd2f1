"""The folders of data that are installed with btcore: the documentation, the trees and the benchmarks."""

from pathlib import Path


def data_folder(name: str) -> Path:
    """Return the folder *name*: in the package if installed, next to it in a checkout."""
    package = Path(__file__).resolve().parent  # a colcon workspace may contain a link to the package
    installed = package / name
    return installed if installed.is_dir() else package.parent / name
