"""The map of a world: occupied, free and unknown cells, keep-out areas, and the command."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from btcore.cli.main import main
from btcore_robot.occupancy_map import load_map
from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.map_rasteriser import overhangs, rasterise
from btcore_sim.world_description import WorldDescription, WorldObject
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import MakeObject

GREY = (128, 128, 128, 255)


@pytest.fixture
def room(box: MakeObject) -> Callable[..., Any]:
    """A closed room of 4 m by 4 m around the origin with walls of 0.2 m."""

    def make(*objects: WorldObject, **changes: object) -> WorldDescription:
        walls = (
            box(2.1, 0.0, (0.2, 4.4, 2.5), name="east"),
            box(-2.1, 0.0, (0.2, 4.4, 2.5), name="west"),
            box(0.0, 2.1, (4.0, 0.2, 2.5), name="north"),
            box(0.0, -2.1, (4.0, 0.2, 2.5), name="south"),
        )
        description = WorldDescription(
            "room", "", (*walls, *objects), (0, 0, 0, 0), 0.0, Pose2D(0, 0, 0), GREY
        )
        return replace(description, **changes)

    return make


def test_walls_on_the_grid_fill_whole_cells(room: Callable[..., Any]) -> None:
    map = rasterise(room())
    assert np.count_nonzero(map.free) == 80 * 80
    assert np.count_nonzero(map.occupied) == 88 * 88 - 80 * 80
    assert map.cells[map.cell(1.99, 0.0)] == 0
    assert map.cells[map.cell(2.01, 0.0)] == 100


def test_unreachable_cells_are_unknown(room: Callable[..., Any], box: MakeObject) -> None:
    closet = [box(1.0, 1.5, (0.1, 1.0, 2.0), name="side"), box(1.5, 1.0, (1.1, 0.1, 2.0), name="front")]
    map = rasterise(room(*closet))
    assert map.cells[map.cell(1.5, 1.5)] == -1
    assert map.cells[map.cell(0.0, 1.5)] == 0
    assert map.cells[0, 0] == -1


def test_a_turned_box_and_a_drum_have_their_areas(
    room: Callable[..., Any], box: MakeObject, drum: MakeObject
) -> None:
    objects = room(box(-0.8, 0.8, (1.2, 0.6, 1.0), yaw=0.5), drum(0.9, -0.9, 0.5))
    occupied = np.count_nonzero(rasterise(objects, 0.02).occupied) - np.count_nonzero(
        rasterise(room(), 0.02).occupied
    )
    perimeter = 2 * (1.2 + 0.6) + math.pi
    # Half a cell is added all around.
    assert occupied * 0.02**2 == pytest.approx(0.72 + math.pi * 0.25 + perimeter * 0.01, rel=0.03)


def test_even_a_thin_leg_is_on_the_map(room: Callable[..., Any], drum: MakeObject) -> None:
    for x in np.linspace(0.5, 0.6, 9):
        map = rasterise(room(drum(float(x), 0.731, 0.01)))
        assert map.occupied[map.cell(0.3, 0.55)[0] : map.cell(0.3, 0.9)[0], map.cell(0.3, 0.0)[1] :].any()


def test_only_fixed_objects_at_height_of_laser_are_on_map(room: Callable[..., Any], box: MakeObject) -> None:
    movable = box(1.0, 0.0, (0.4, 0.4, 0.5), mass=3.0, name="movable")
    person = replace(box(-1.0, 0.0, (0.4, 0.4, 0.5), name="person"), is_kinematic=True)
    flat = box(0.0, 1.0, (0.4, 0.4, 0.05), name="flat")
    board = replace(box(0.0, -1.0, (0.4, 0.4, 0.05), name="board"), position=(0.0, -1.0, 0.7))
    lamp = replace(box(1.0, 1.0, (0.2, 0.2, 0.3), name="lamp"), position=(1.0, 1.0, 2.0))
    description = room(movable, person, flat, board, lamp)
    assert (rasterise(description).cells == rasterise(room()).cells).all()
    assert overhangs(description) == ((-0.2, 0.8, 0.2, 1.2), (-0.2, -1.2, 0.2, -0.8))
    assert ClearanceMap.of(description).clearance_at(1.0, 0.0) == 0.0


def test_keep_out_areas_of_the_world_are_on_the_map(room: Callable[..., Any]) -> None:
    description = room(keepout=((0.5, 0.5, 1.0, 1.5),))
    assert rasterise(description).keepout == ((0.5, 0.5, 1.0, 1.5),)
    floor = ClearanceMap.of(description)
    assert floor.clearance_at(0.75, 1.0) == 0.0
    assert floor.clearance_at(0.0, 1.0) == pytest.approx(0.5, abs=0.05)


def test_clearance_along_line_is_that_of_narrowest_place(room: Callable[..., Any], box: MakeObject) -> None:
    floor = ClearanceMap.of(room(box(0.0, 1.2, (0.4, 0.4, 1.0))))
    assert floor.clearance_along((-1.5, 0.0), (1.5, 0.0)) == pytest.approx(0.5, abs=0.06)
    assert floor.clearance_along((-1.5, 1.2), (1.5, 1.2)) == 0.0
    assert floor.clearance_along((0.0, 0.0), (9.0, 0.0)) == 0.0


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["map", *arguments])


@pytest.mark.parametrize("name", ["house", "aws_house", "arena_boxes"])
def test_the_command_writes_a_map_that_can_be_loaded(tmp_path: Path, name: str) -> None:
    ended = run(name, "-o", str(tmp_path / "maps"))
    assert ended.exit_code == 0, ended.output
    assert f"{name}.yaml and {name}.pgm: " in ended.output
    read, drawn = load_map(tmp_path / "maps" / f"{name}.yaml"), rasterise(load_world_description(name))
    assert (read.cells == drawn.cells).all()
    assert (read.resolution, read.origin, read.keepout) == (drawn.resolution, drawn.origin, drawn.keepout)
    assert ("keepout.yaml" in ended.output) == bool(drawn.keepout)


def test_the_command_accepts_a_resolution(tmp_path: Path) -> None:
    assert "of 0.1 m" in run("arena", "-o", str(tmp_path), "--resolution", "0.1").output
    assert load_map(tmp_path / "arena.yaml").resolution == 0.1


def test_the_command_reports_usage_errors(tmp_path: Path) -> None:
    ended = run("hose", "-o", str(tmp_path))
    assert (ended.exit_code, "did you mean 'house'?" in ended.output) == (2, True)
    (tmp_path / "taken").write_text("")
    ended = run("arena", "-o", str(tmp_path / "taken" / "maps"))
    assert (ended.exit_code, "cannot write the map" in ended.output) == (2, True)
