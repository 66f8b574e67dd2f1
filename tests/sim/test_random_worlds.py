"""Random offices and homes: reachable, furnished, closed, and the same for the same seed."""

import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from btcore import SettingsError
from btcore.cli.main import main
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.laser import RayCaster
from btcore_sim.providers import parse_worlds
from btcore_sim.random_world_kinds import KINDS
from btcore_sim.random_worlds import (
    DOOR_WIDTHS,
    MIN_WAY_CLEARANCE,
    MIN_WAYPOINT_CLEARANCE,
    random_world,
    random_world_json,
)
from btcore_sim.worlds import load_world_description
from btcore_sweep.command import sweep
from btcore_sweep.definition import create_definition

GRID_ERROR = 0.05  # m: the map is exact to a cell


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rooms", [2, 6, 9, 24])
def test_a_robot_can_drive_to_a_waypoint_in_each_room(kind: str, rooms: int) -> None:
    for seed in range(4 if rooms < 10 else 1):
        description = random_world(kind, seed, rooms)
        assert list(description.waypoints) == ["start", "recharge", *(f"wp{n}" for n in range(1, rooms + 1))]
        assert description.pose is not None
        assert (description.pose.x, description.pose.y) == pytest.approx(
            description.waypoints["start"], abs=0.03
        )
        floor, places = ClearanceMap.of(description), list(description.waypoints.values())
        assert floor.connected(places, MIN_WAY_CLEARANCE - GRID_ERROR)
        assert all(floor.clearance_at(*place) >= MIN_WAYPOINT_CLEARANCE - GRID_ERROR for place in places)


@pytest.mark.parametrize("kind", KINDS)
def test_no_ray_at_the_height_of_the_laser_or_the_camera_leaves_the_world(kind: str) -> None:
    around = np.linspace(-math.pi, math.pi, 1440, endpoint=False)
    for seed, height in itertools.product(range(4), (0.0945, 1.07, 2.4)):
        description = random_world(kind, seed)
        walls = RayCaster.of([item for item in description.objects if item.name.startswith("wall_")])
        for place in description.waypoints.values():
            assert np.isfinite(walls.distances(*place, height, around)).all()


@pytest.mark.parametrize("kind", KINDS)
def test_objects_do_not_overlap_walls_and_furniture_stands_in_most_rooms(kind: str) -> None:
    for seed in range(4):
        objects = random_world(kind, seed).objects
        walls = [item for item in objects if item.name.startswith("wall_")]
        furniture = [item for item in objects if not item.name.startswith("wall_")]
        assert len({item.name.rpartition("_")[0] for item in furniture}) >= 6
        for wall, item in itertools.product(walls, furniture):
            a, b = wall.outline(), item.outline()
            assert min(a[2], b[2]) - max(a[0], b[0]) <= 1e-6 or min(a[3], b[3]) - max(a[1], b[1]) <= 1e-6


def test_doors_have_all_widths_between_80_and_120_cm() -> None:
    widths = set()
    for seed in range(12):
        world = random_world_json("office", seed)
        corridor = [item for item in world["objects"] if item["name"].startswith("wall_")]
        rows: dict[float, list[tuple[float, float]]] = {}
        for wall in corridor:
            if wall["size"][0] > wall["size"][1]:
                x, half = wall["position"][0], wall["size"][0] / 2
                rows.setdefault(wall["position"][1], []).append((x - half, x + half))
        for spans in rows.values():
            spans.sort()
            widths |= {round(right[0] - left[1], 3) for left, right in itertools.pairwise(spans)}
    assert widths == set(DOOR_WIDTHS)


def test_the_same_seed_gives_the_same_world_and_another_seed_another() -> None:
    assert random_world_json("home", 5) == random_world_json("home", 5)
    assert random_world_json("home", 5) != random_world_json("home", 6)
    assert random_world_json("home", 5, 7) != random_world_json("home", 5)


def test_command_writes_world_that_name_means(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["world", "office", "--seed", "3"])
    assert result.exit_code == 0
    assert "office_3.json: a random office of 6 rooms, seed 3" in result.stdout
    written, named = load_world_description("office_3.json"), load_world_description("office:3")
    assert written == named
    assert json.loads(Path("office_3.json").read_text())["waypoints"]["start"]
    failed = CliRunner().invoke(main, ["world", "home", "-o", "missing/home.json"])
    assert failed.exit_code == 2
    assert "cannot write the world" in failed.stderr


def test_worlds_of_a_sweep_are_names_and_ranges() -> None:
    assert parse_worlds("house, office:2-4,home:7") == ["house", "office:2", "office:3", "office:4", "home:7"]
    for wrong in ("office:4-2", "office:1-2,office:2", "home:1-99999"):
        with pytest.raises(SettingsError, match="--worlds"):
            parse_worlds(wrong)


def test_a_sweep_varies_the_world() -> None:
    words = ["bumpgo", "--seeds", "2", "--worlds", "arena,office:1-2", "--camera", "off"]
    with sweep.make_context("sweep", list(words)) as context:
        definition = create_definition(context, "bumpgo", (), (0, 1), 10.0)
    worlds = [episode.command[episode.command.index("--world") + 1] for episode in definition]
    assert worlds == 2 * ["arena", "office:1", "office:2"]
    for wrong in (["--param", "world=house"], ["--world", "house"]):
        result = CliRunner().invoke(main, ["sweep", *words, *wrong])
        assert result.exit_code == 2
        assert "cannot be used together" in result.stderr


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("ofice", "did you mean 'office:1'?"),
        ("hom:12", "did you mean 'home:12'?"),
        ("hous", "did you mean 'house'?"),
        ("flat", "did you mean 'flat.json'?"),
        ("xyz", "lobby, office:N, home:N (random; N is a number); or use the path of a world file"),
        ("flaat.json", "flaat.json: no such file; did you mean 'flat.json'?"),
        ("plam.yaml", "plam.yaml: no such file; did you mean 'plan.yaml'?"),
    ],
)
def test_similar_names_of_worlds_and_files_are_suggested(
    name: str, hint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for file in ("flat.json", "plan.yaml"):
        Path(file).touch()
    with pytest.raises(SimError, match=re.escape(hint)):
        load_world_description(name)
