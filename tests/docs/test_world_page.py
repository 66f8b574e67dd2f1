"""The guide of worlds: its tables of keys, and its pictures of the kinds of objects."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "site"))

for module in ("numpy", "cv2", "pybullet"):
    pytest.importorskip(module, reason="the tables and pictures are made by the simulator")

import world_keys  # noqa: E402
import world_pictures  # noqa: E402


def test_the_tables_are_those_of_the_schema() -> None:
    page = (ROOT / "docs/guides/worlds.md").read_text(encoding="utf-8")
    assert world_keys.tables() in page, "python docs/site/world_keys.py prints the present tables"


def test_the_pictures_can_be_drawn_and_are_small() -> None:
    picture = world_pictures.kinds()
    tiles = [tile for row in (picture[:229], picture[229:]) for tile in (row[:, :304], row[:, 304:608])]
    assert all(len({tuple(color) for line in tile for color in line}) > 20 for tile in tiles)
    for name in ("world_kinds.png", "world_lobby.png", "random_worlds.png"):
        assert (ROOT / "docs/images" / name).stat().st_size < 100_000
