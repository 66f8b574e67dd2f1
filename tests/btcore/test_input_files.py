"""Files that may come from strangers are read only if they are regular files of a limited size."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from btcore.errors import TreeError
from btcore.input_files import parse_size, read_error, read_file, real_path
from btcore.logs.btlog import read_btlog
from btcore.logs.files import LogError
from btcore.registry.registry import Registry
from btcore.testing.substitution_rules import load_substitution_rules
from btcore.xml.models.model_file import add_models
from btcore.xml.read.read import parse_file
from btcore_monitor.logs import read_fbl, read_sqlite

IRREGULAR = {
    "pipe": "it is a named pipe, not a regular file",
    "device": "it is a device, not a regular file",
    "loop": "oo many levels of symbolic links",
}
READERS: dict[Callable[[Path], object], type[Exception]] = {
    read_file: OSError,
    parse_file: TreeError,
    lambda path: add_models(Registry.standard(), path): TreeError,
    lambda path: load_substitution_rules(Registry.standard(), path): OSError,
    read_btlog: LogError,
    read_fbl: LogError,
    read_sqlite: LogError,
}


@pytest.fixture
def irregular(tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A path that is not a regular file."""
    path = tmp_path / "file"
    if request.param == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(path if request.param == "loop" else "/dev/zero")
    return path


@pytest.mark.parametrize("irregular", IRREGULAR, indirect=True)
@pytest.mark.parametrize(("read", "error"), READERS.items())
def test_readers_refuse_pipes_devices_and_loops_of_links_without_waiting(
    irregular: Path, read: Callable[[Path], object], error: type[Exception], request: pytest.FixtureRequest
) -> None:
    with pytest.raises(error) as caught:
        read(irregular)
    reason = read_error(caught.value) if isinstance(caught.value, OSError) else str(caught.value)
    assert IRREGULAR[request.node.callspec.params["irregular"]] in reason


@pytest.mark.parametrize(("read", "error"), READERS.items())
def test_readers_refuse_files_above_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, read: Callable[[Path], object], error: type[Exception]
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b" " * 2_001)
    monkeypatch.setenv("BTCORE_MAX_FILE_SIZE", "2kB")
    with pytest.raises(error, match="it is larger than 2 kB; to read it, use 'btcore --max-file-size"):
        read(path)


def test_file_of_exactly_the_limit_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * 2_000)
    monkeypatch.setenv("BTCORE_MAX_FILE_SIZE", "2kB")
    assert read_file(path) == b"x" * 2_000
    assert read_file(path, 3) == b"xxx"


def test_file_without_a_size_is_read_up_to_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    # Files in /proc report the size 0.
    assert read_file("/proc/self/status").startswith(b"Name:")
    monkeypatch.setenv("BTCORE_MAX_FILE_SIZE", "20")
    with pytest.raises(OSError, match="larger than 20 bytes"):
        read_file("/proc/self/status")


def test_folder_is_refused_and_no_descriptor_is_left_open(tmp_path: Path) -> None:
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(10):
        with pytest.raises(IsADirectoryError):
            read_file(tmp_path)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_real_path_of_a_loop_of_links_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    assert real_path(tmp_path / "a").parent == tmp_path.resolve()


@pytest.mark.parametrize(
    ("text", "size"),
    [("0", 0), ("2000", 2_000), ("2kB", 2_000), (" 1.5 GB ", 1_500_000_000), ("3mb", 3 * 10**6)],
)
def test_sizes_are_numbers_with_an_optional_unit(text: str, size: int) -> None:
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "-1", "1TB", "many", "1e3", "nan"])
def test_invalid_sizes_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="is not the size of a file"):
        parse_size(text)
