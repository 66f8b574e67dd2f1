"""Map files: cells, the modes of map_server, keepouts and errors in files."""

import os
import struct
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from btcore_robot.occupancy_map import MapError, OccupancyMap, load_map, save_map

ROOM = np.array([[100, 100, 100, 100], [100, 0, 0, -1], [100, 0, 0, 100]], dtype=np.int8)
"""Row 0 is the lowest y."""


def cells(values: st.SearchStrategy[int]) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.int8, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=12), elements=values)


def written(folder: Path, text: str, pixels: np.ndarray | None = None, name: str = "room.pgm") -> Path:
    """Write a map file with a text, and an image with pixels beside it; return the file's path."""
    if pixels is not None:
        assert cv2.imwrite(str(folder / name), pixels)
    path = folder / "room.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def loaded(folder: Path, pixels: list[list[int]], **keys: object) -> list[list[int]]:
    """Return the cells of a map with these pixels, in the order of the image: the highest y first."""
    lines = {"image": "room.pgm", "resolution": 0.05, "origin": [0, 0, 0]} | keys
    text = "".join(f"{key}: {value}\n" for key, value in lines.items())
    found = load_map(written(folder, text, np.array(pixels, dtype=np.uint8)))
    return np.flipud(found.cells).tolist()


# -- saving and loading


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    cells=cells(st.sampled_from([-1, 0, 100])) | cells(st.integers(-1, 100)),
    resolution=st.floats(0.001, 2.0),
    origin=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    keepout=st.lists(
        st.tuples(st.floats(-9, 0), st.floats(-9, 0), st.floats(0.1, 9), st.floats(0.1, 9)), max_size=3
    ),
)
def test_a_saved_map_is_loaded_unchanged(
    tmp_path: Path,
    cells: np.ndarray,
    resolution: float,
    origin: tuple[float, float],
    keepout: list[tuple[float, ...]],
) -> None:
    path = tmp_path / "any.yaml"
    save_map(OccupancyMap(cells, resolution, origin, tuple(keepout)), path)
    found = load_map(path)
    assert np.array_equal(found.cells, cells)
    assert found.cells.dtype == np.int8
    assert (found.resolution, found.origin) == (resolution, origin)
    assert found.keepout == tuple(keepout)


def test_the_first_row_of_the_image_is_the_highest_y(tmp_path: Path) -> None:
    save_map(OccupancyMap(ROOM, 0.05, (0.0, 0.0)), tmp_path / "room.yaml")
    image = cv2.imread(str(tmp_path / "room.pgm"), cv2.IMREAD_UNCHANGED)
    assert image[0].tolist() == [0, 254, 254, 0]
    assert image[-1].tolist() == [0, 0, 0, 0]


def test_a_map_is_a_binary_pgm_and_has_the_thresholds_of_map_saver(tmp_path: Path) -> None:
    save_map(OccupancyMap(ROOM, 0.05, (-9.93, -14.1)), tmp_path / "room.yaml")
    assert (tmp_path / "room.pgm").read_bytes().startswith(b"P5\n4 3\n255\n")
    text = (tmp_path / "room.yaml").read_text(encoding="utf-8")
    for line in ("occupied_thresh: 0.65", "free_thresh: 0.25", "origin: [-9.93, -14.1, 0]", "mode: trinary"):
        assert line in text.splitlines()


def test_a_map_saved_without_keepouts_loses_those_of_the_file_it_replaces(tmp_path: Path) -> None:
    path = tmp_path / "room.yaml"
    save_map(OccupancyMap(ROOM, 0.05, (0.0, 0.0), ((0.0, 0.0, 0.1, 0.1),)), path)
    save_map(OccupancyMap(ROOM, 0.05, (0.0, 0.0)), path)
    assert load_map(path).keepout == ()


# -- how pixels are read, by map_server's rules


def test_trinary_mode_has_free_occupied_and_unknown_cells(tmp_path: Path) -> None:
    # Darkness: 0, 0.004, 0.25 (just under), 0.251, 0.647, 0.651, 1
    assert loaded(tmp_path, [[255, 254, 192, 191, 90, 89, 0]]) == [[0, 0, 0, -1, -1, 100, 100]]


def test_205_is_unknown_with_the_threshold_of_ros_1_and_free_with_ros_2s(tmp_path: Path) -> None:
    assert loaded(tmp_path, [[205]], free_thresh=0.196) == [[-1]]
    assert loaded(tmp_path, [[205]], free_thresh=0.25) == [[0]]


def test_a_darkness_equal_to_the_threshold_counts(tmp_path: Path) -> None:
    # 51 of 255 is 0.2
    assert loaded(tmp_path, [[204]], free_thresh=0.2) == [[0]]
    assert loaded(tmp_path, [[51]], occupied_thresh=0.8) == [[100]]


@pytest.mark.parametrize("negate", [1, "true"])
def test_a_negated_map_has_its_obstacles_white(tmp_path: Path, negate: int | str) -> None:
    assert loaded(tmp_path, [[0, 128, 255]], negate=negate) == [[0, -1, 100]]


def test_scale_mode_interpolates_between_the_thresholds(tmp_path: Path) -> None:
    pixels = [[255, 204, 153, 128, 51, 0]]
    keys = {"mode": "scale", "free_thresh": 0.2, "occupied_thresh": 0.8}
    assert loaded(tmp_path, pixels, **keys) == [[0, 0, 33, 50, 100, 100]]


def test_raw_mode_reads_pixels_as_percentages(tmp_path: Path) -> None:
    assert loaded(tmp_path, [[0, 42, 100, 101, 255]], mode="raw") == [[0, 42, 100, -1, -1]]


def test_a_png_is_read_and_its_transparent_pixels_are_unknown(tmp_path: Path) -> None:
    pixels = np.array([[[255, 255, 255, 255], [0, 0, 0, 255], [0, 0, 0, 0]]], dtype=np.uint8)
    path = written(tmp_path, "image: room.png\nresolution: 0.1\norigin: [1, 2]\n", pixels, "room.png")
    found = load_map(path)
    assert found.cells.tolist() == [[0, 100, -1]]
    assert (found.resolution, found.origin) == (0.1, (1.0, 2.0))


def test_a_png_of_16_bits_is_read_like_a_png_of_8_bits(tmp_path: Path) -> None:
    pixels = np.array([[65535, 32768, 0]], dtype=np.uint16)
    path = written(tmp_path, "image: room.png\nresolution: 0.1\norigin: [0, 0, 0]\n", pixels, "room.png")
    assert load_map(path).cells.tolist() == [[0, -1, 100]]


# -- places and cells


@given(st.integers(-50, 50), st.integers(-50, 50), st.sampled_from([0.05, 0.025, 0.1, 0.3]))
def test_the_centre_of_a_cell_lies_in_the_cell(row: int, col: int, resolution: float) -> None:
    map = OccupancyMap(ROOM, resolution, (-9.93, -14.1))
    assert map.cell(*map.center(row, col)) == (row, col)
    points = map.centers(np.array([row]), np.array([col]))
    assert map.indices(points).tolist() == [[row, col]]
    assert points[0].tolist() == pytest.approx(map.center(row, col))


def test_bounds_and_masks_of_a_map() -> None:
    map = OccupancyMap(ROOM, 0.5, (1.0, 2.0))
    assert map.bounds == (1.0, 2.0, 3.0, 3.5)
    assert map.inside(1.0, 2.0)
    assert map.inside(2.99, 3.49)
    assert not map.inside(3.0, 3.0)
    assert not map.inside(0.99, 3.0)
    assert (map.occupied.sum(), map.free.sum(), map.unknown.sum()) == (7, 4, 1)


def test_a_keepout_covers_the_cells_that_it_touches() -> None:
    empty = np.zeros((6, 8), dtype=np.int8)
    map = OccupancyMap(empty, 0.05, (0.0, 0.0), ((0.1, 0.05, 0.3, 0.15), (0.36, 0.26, 9.0, 9.0)))
    assert np.argwhere(map.keepout_mask()).tolist() == [
        *([row, col] for row in (1, 2) for col in (2, 3, 4, 5)),
        [5, 7],
    ]


def test_a_keepout_outside_the_map_covers_no_cell() -> None:
    empty = np.zeros((6, 8), dtype=np.int8)
    assert not OccupancyMap(empty, 0.05, (0.0, 0.0), ((-3.0, -3.0, -1.0, -1.0),)).keepout_mask().any()


# -- errors

GOOD = "image: room.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD.replace("resolution", "reslution"), ":2: 'reslution' is unknown: known are image, resolution"),
        (GOOD.replace("0.05", "-1"), ":2: 'resolution' is -1, and a number greater than 0 is expected"),
        (GOOD.replace("[0, 0, 0]", "[0, 0, 1.5]"), ":3: 'origin' rotates the map by 1.5 rad"),
        (GOOD + "negate: 2\n", ":4: 'negate' is 2, and 0 or 1 or true or false is expected"),
        (GOOD + "free_thresh: 0.7\n", ":4: 'free_thresh' must satisfy 0 ≤ free_thresh (0.7) < occupied_th"),
        (GOOD.replace("room.pgm", "cellar.pgm"), ":1: 'image' is 'cellar.pgm', but there is no file "),
        (GOOD.replace("room.pgm", "room.yaml"), ":1: 'image' is 'room.yaml', which is not a readable image"),
        ("image: [\n", ":2:1: not valid YAML: "),
        ("- room.pgm\n", ":1: expected 'key: value' lines of a map"),
        ("", ":1: expected 'key: value' lines of a map"),
    ],
)  # fmt: skip
def test_an_error_is_reported_with_file_and_line(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, text, np.zeros((2, 2), dtype=np.uint8))
    with pytest.raises(MapError) as fault:
        load_map(path)
    assert str(fault.value).startswith(f"{path}{message}")


def test_unknown_keys_without_a_similar_key_are_ignored(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD + "author: somebody\n", np.zeros((2, 2), dtype=np.uint8))
    assert load_map(path).cells.shape == (2, 2)


def test_numbers_may_have_an_exponent(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("0.05", "5e-2"), np.zeros((2, 2), dtype=np.uint8))
    assert load_map(path).resolution == 0.05


def test_small_file_with_a_huge_image_is_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "huge.png"), np.zeros((4, 4), np.uint8))
    data = bytearray((tmp_path / "huge.png").read_bytes())
    data[16:24] = struct.pack(">II", 8_001, 8_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    (tmp_path / "huge.png").write_bytes(data)
    (tmp_path / "huge.yaml").write_text("image: huge.png\nresolution: 0.05\norigin: [0, 0, 0]\n")
    with pytest.raises(MapError, match=r"'image' is 'huge\.png', which has more than 64,000,000 pixels"):
        load_map(tmp_path / "huge.yaml")


def test_a_missing_or_unreadable_map_raises(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "room.png"), np.zeros((4, 4), np.uint8))
    with pytest.raises(MapError, match=r"room\.png: not a text file; expected a YAML file of a map, not"):
        load_map(tmp_path / "room.png")
    with pytest.raises(MapError, match=r"cannot read the file: Is a directory$"):
        load_map(tmp_path)
    with pytest.raises(MapError, match=r"attic\.yaml: no such file"):
        load_map(tmp_path / "attic.yaml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("keepout: [[1, 1, 0, 2]]\n", ":1: 'keepout' has the rectangle [1, 1, 0, 2]"),
        ("# tables\nkeepout: [[1, 1, 0]]\n", ":2: 'keepout[0]' is [1, 1, 0], and a list of 4 numbers"),
    ],
)
def test_errors_in_keepouts_are_reported_with_keepout_file(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, GOOD, np.zeros((2, 2), dtype=np.uint8))
    beside = tmp_path / "room.keepout.yaml"
    beside.write_text(text, encoding="utf-8")
    with pytest.raises(MapError) as fault:
        load_map(path)
    assert str(fault.value).startswith(f"{beside}{message}")


@pytest.mark.skipif(os.name != "posix", reason="other systems raise a different error")
def test_a_map_that_cannot_be_written_raises(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"nowhere.*: cannot write the map: "):
        save_map(OccupancyMap(ROOM, 0.05, (0.0, 0.0)), tmp_path / "nowhere" / "room.yaml")


@pytest.mark.parametrize("resolution", [0.0, -0.05, float("nan"), float("inf")])
def test_a_map_without_a_positive_resolution_is_refused(resolution: float) -> None:
    with pytest.raises(MapError, match="the side of a cell must be greater than 0 m"):
        OccupancyMap(ROOM, resolution, (0.0, 0.0))


@pytest.mark.skipif(os.name != "posix", reason="needs named pipes")
def test_a_map_or_an_image_that_is_a_named_pipe_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(MapError, match="it is a named pipe, not a regular file"):
        load_map(tmp_path / "pipe.yaml")
    path = written(tmp_path, GOOD, np.zeros((2, 2), dtype=np.uint8))
    image = next(tmp_path.glob("*.pgm"))
    image.unlink()
    os.mkfifo(image)
    with pytest.raises(MapError, match="cannot be read: it is a named pipe"):
        load_map(path)


def test_a_map_file_above_the_limit_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BTCORE_MAX_FILE_SIZE", "2kB")
    (tmp_path / "map.yaml").write_bytes(b" " * 2_001)
    with pytest.raises(MapError, match="it is larger than 2 kB"):
        load_map(tmp_path / "map.yaml")


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("[" * 100_000 + "]" * 100_000, ":1:100: not valid YAML: nested too deeply"),
        (
            "".join(" " * depth + "a:\n" for depth in range(500)),
            ":100:100: not valid YAML: nested too deeply",
        ),
        ("a: &a [x, x]\n? *a\n: 1\n", ":1:4: not valid YAML: a key must be a single value"),
    ],
)
def test_nesting_and_keys_of_a_map_file_are_bounded(tmp_path: Path, text: str, error: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(100_000)  # as after a deep tree was loaded
    try:
        with pytest.raises(MapError, match=error):
            load_map(tmp_path / "map.yaml")
    finally:
        sys.setrecursionlimit(limit)
