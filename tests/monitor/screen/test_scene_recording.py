"""The scene of a navigating robot: how its events are written to the recording."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from btcore_monitor.events import MovingSceneEvent, StaticSceneEvent, TreeEvent
from btcore_monitor.screen.navigation_markers import POSE_STYLES
from btcore_monitor.screen.shapes import archetypes, extent
from btcore_monitor.screen.style import GROOT
from btcore_scene import (
    UPRIGHT,
    Area,
    Arrow,
    BoundingBox,
    Box,
    Camera,
    Detection,
    Frame,
    Grid,
    Mesh,
    MovingScene,
    Picture,
    Place,
    Poses,
    StaticScene,
    float32,
)
from tests.monitor.screen.conftest import Recording

SECOND = 10**9


def rows(name: str, kind: str, *poses: tuple[float, float, float], frame: str = "map") -> Poses:
    return Poses(name=name, kind=kind, frame=frame, rows=np.array(poses, dtype="<f4").tobytes())


def grid(
    name: str, kind: str, cells: list[list[int]], origin: tuple[float, float] = (1.0, 2.0), frame: str = "map"
) -> Grid:
    return Grid(
        name=name,
        kind=kind,
        frame=frame,
        resolution=0.5,
        origin=origin,
        size=(len(cells[0]), len(cells)),
        cells=bytes(value & 255 for line in cells for value in line),
    )


STATIC = StaticScene(
    frame="map",
    footprint_radius=0.25,
    battery=100.0,
    places=[Place(name="wp1", position=(1.0, -2.0, 0.0))],
    areas=[Area(name="table", corners=(0.0, 0.0, 1.0, 0.5))],
    cameras=[Camera(name="camera", frame="optical", size=(32, 24), focal=(30.0, 30.0))],
    grids=[grid("map", "occupancy", [[0, 100, -1], [0, 0, -1]])],
)


@pytest.fixture
def show(run: Callable[..., Any], recorded: Callable[..., Any], tmp_path: Path) -> Callable[..., Any]:
    """``show({second: changes, …})``: the recording of these changes."""

    def made(moved: dict[float, dict], static: StaticScene = STATIC):
        seen = next(event for event in run(1) if isinstance(event, TreeEvent))
        events = [seen, StaticSceneEvent(static)]
        for t, changed in moved.items():
            events.append(MovingSceneEvent(round(t * SECOND), round(t * SECOND), MovingScene(**changed)))
        return recorded(events, tmp_path / "run.rrd")

    return made


def colours(recording: Recording, name: str, t: float) -> np.ndarray:
    entity = f"/scene/grids/{name}"
    data = recording.at(entity, "GridMap:data", round(t * SECOND))[0]
    size = recording.at(entity, "GridMap:format", round(t * SECOND))[0]
    return np.array(data, dtype=np.uint8).reshape(size["height"], size["width"], 4)


def test_the_map_is_at_its_origin_and_unknown_cells_are_transparent(show: Callable[..., Any]) -> None:
    recording = show({0.0: {}})
    painted = colours(recording, "map", 0.0)
    assert painted[1, 1, 3] == 255  # occupied, in the lowest row, which is an image's last
    assert 0 < painted[0, 0, 3] < 255
    assert painted[:, 2, 3].tolist() == [0, 0]
    place = recording.at("/scene/grids/map", "GridMap:translation", 0)[0]
    assert place[:2] == [1.0, 2.0]
    assert recording.at("/scene/grids/map", "GridMap:cell_size", 0) == [0.5]


def test_a_costmap_is_painted_and_stays_until_the_next_costmap(show: Callable[..., Any]) -> None:
    costs = grid("local_costmap", "costs", [[0, 1, 252], [253, 254, 255]], (0.0, 0.0), frame="odom")
    later = grid("local_costmap", "costs", [[0, 0, 0], [0, 0, 0]], (3.0, 0.0), frame="odom")
    recording = show({1.0: {"grids": [costs]}, 5.0: {"grids": [later]}})
    below, above = colours(recording, "local_costmap", 4.9)[::-1]
    assert below[0, 3] == above[2, 3] == 0  # free, and unknown
    assert below[1, 2] > below[1, 0]  # low costs are blue, high costs are red
    assert below[2, 0] > below[2, 2]
    assert above[0].tolist()[:3] == [0, 225, 225]  # inscribed: cyan
    assert above[1].tolist()[:3] == [255, 0, 220]  # lethal: magenta
    assert not colours(recording, "local_costmap", 5.0)[:, :, 3].any()
    assert recording.at("/scene/grids/local_costmap", "GridMap:translation", 6 * SECOND)[0][0] == 3.0
    assert recording.of("/scene/grids/local_costmap", "CoordinateFrame:frame")[0][1] == ["odom"]
    heights = [
        recording.at(f"/scene/grids/{name}", "GridMap:translation", 6 * SECOND)[0][2]
        for name in ("map", "local_costmap")
    ]
    assert heights[0] < heights[1]


def test_places_and_keep_outs_are_drawn_once(show: Callable[..., Any]) -> None:
    recording = show({0.0: {}})
    assert recording.of("/scene/places", "Points3D:labels") == [(None, ["wp1"])]
    strips = recording.of("/scene/areas", "LineStrips3D:strips")[0][1]
    xs, ys, _ = zip(*(point for strip in strips for point in strip), strict=True)
    assert (min(xs), max(xs), min(ys), max(ys)) == (0.0, 1.0, 0.0, 0.5)


def test_a_path_is_a_line_until_an_empty_path_arrives(show: Callable[..., Any]) -> None:
    path = rows("path", "path", (0, 0, 0), (1, 0, 0), (1, 1, 1.5))
    recording = show({1.0: {"poses": [path]}, 2.0: {}, 3.0: {"poses": [rows("path", "path")]}})
    paths = recording.of("/scene/poses/path", "LineStrips3D:strips")
    assert [t for t, _ in paths] == [SECOND, 3 * SECOND]
    assert [point[:2] for point in paths[0][1][0]] == [[0, 0], [1, 0], [1, 1]]
    assert paths[1][1] == []
    assert recording.of("/scene/poses/path", "LineStrips3D:colors") == [(None, [POSE_STYLES["path"].colour])]


@pytest.mark.parametrize(("kind", "strips"), [("cloud", 1), ("goal", 3), ("estimate", 2), ("odometry", 2)])
def test_each_kind_of_pose_has_its_shape_at_its_position_and_heading(
    show: Callable[..., Any], kind: str, strips: int
) -> None:
    recording = show({1.0: {"poses": [rows("it", kind, (2.0, 3.0, np.pi / 2))]}})
    drawn = recording.of("/scene/poses/it", "LineStrips3D:strips")[0][1]
    assert len(drawn) == strips
    points = np.array([point[:2] for strip in drawn for point in strip])
    assert np.abs(points - (2.0, 3.0)).max() < 0.6
    furthest = points[np.linalg.norm(points - (2.0, 3.0), axis=1).argmax()]
    assert furthest[0] == pytest.approx(2.0, abs=1e-6)
    assert furthest[1] > 3.0


def test_unchanged_poses_are_not_written_again(show: Callable[..., Any]) -> None:
    goal = {"poses": [rows("goal", "goal", (1, 2, 0))]}
    recording = show({1.0: goal, 2.0: goal, 3.0: goal})
    assert len(recording.of("/scene/poses/goal", "LineStrips3D:strips")) == 1


def test_arrows_stay_until_a_list_without_them(show: Callable[..., Any]) -> None:
    push = Arrow(name="push", frame="base_link", start=(0, 0, 0), end=(1, 2, 0), color=(255, 0, 0, 255))
    pull = replace(push, name="pull", end=(0, 1, 0))
    recording = show({1.0: {"arrows": [push, pull]}, 2.0: {"arrows": [push]}, 3.0: {}, 4.0: {"arrows": []}})
    assert recording.of("/scene/arrows/push", "Arrows3D:vectors") == [(SECOND, [[1, 2, 0]]), (4 * SECOND, [])]
    assert recording.of("/scene/arrows/pull", "Arrows3D:vectors") == [(SECOND, [[0, 1, 0]]), (2 * SECOND, [])]
    assert recording.of("/scene/arrows/push", "CoordinateFrame:frame") == [(None, ["base_link"])]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [1, 3, 4])
def test_names_of_any_number_of_places_have_the_text_colour(show: Callable[..., Any], count: int) -> None:
    places = [Place(name=f"wp{at}", position=(at, 0.0, 0.0)) for at in range(count)]
    recording = show({0.0: {}}, replace(STATIC, places=places))
    assert recording.of("/scene/places", "Points3D:colors")[0][1] == [GROOT.text] * count


def test_a_robot_without_a_footprint_gets_a_footprint_below_its_base_link(show: Callable[..., Any]) -> None:
    at = [Frame("base_link", "map", (1.0, 2.0, 0.25), UPRIGHT)]
    recording = show({1.0: {"frames": at}, 2.0: {"frames": at}})
    footprint = "/scene/frames/base_footprint"
    assert recording.of(footprint, "Transform3D:translation") == [(SECOND, [[0.0, 0.0, -0.25]])]
    assert recording.of(footprint, "Transform3D:parent_frame")[0][1] == ["base_link"]


def test_a_footprint_in_the_scene_replaces_the_default_footprint(show: Callable[..., Any]) -> None:
    link = Frame("base_link", "map", (1.0, 2.0, 0.25), UPRIGHT)
    own = Frame("base_footprint", "map", (5.0, 6.0, 0.0), UPRIGHT)
    footprint = show({1.0: {"frames": [link]}, 2.0: {"frames": [own]}}).of
    parents = footprint("/scene/frames/base_footprint", "Transform3D:parent_frame")
    assert parents == [(SECOND, ["base_link"]), (2 * SECOND, ["map"])]


def test_jitter_is_ignored_and_slow_motion_is_recorded(show: Callable[..., Any]) -> None:
    def at(x: float) -> dict:
        return {"frames": [Frame("thing", "map", (x, 0.0, 0.0), UPRIGHT)]}

    steps = {float(t): at(1.0 + 1e-5 * ((t + 1) % 2)) for t in range(1, 6)}
    creep = {6.0 + t: at(1.0 + 1.5e-5 * t) for t in range(1, 6)}
    rows = show({**steps, **creep}).of("/scene/frames/thing", "Transform3D:translation")
    assert [t // SECOND for t, _ in rows] == [1, 8, 10]


def test_bounding_boxes_stay_until_a_list_without_them(show: Callable[..., Any]) -> None:
    table = BoundingBox(name="table", frame="map", position=(1, 2, 0.5), size=(2, 1, 1))
    turned = replace(table, frame="odom", quaternion=(0, 0, 1, 0), color=(1, 2, 3, 255))
    recording = show({1.0: {"boxes": [table, turned]}, 2.0: {"boxes": [table]}, 3.0: {}, 4.0: {"boxes": []}})
    halves = recording.of("/scene/boxes/map", "Boxes3D:half_sizes")
    assert halves == [(SECOND, [[1.0, 0.5, 0.5]]), (4 * SECOND, [])]
    assert recording.of("/scene/boxes/map", "Boxes3D:centers")[0][1] == [[1.0, 2.0, 0.5]]
    assert [t for t, _ in recording.of("/scene/boxes/odom", "Boxes3D:half_sizes")] == [SECOND, 2 * SECOND]
    assert recording.of("/scene/boxes/odom", "CoordinateFrame:frame") == [(None, ["odom"])]
    assert recording.of("/scene/boxes/odom", "Boxes3D:colors")[0][1] == [0x010203FF]


@pytest.mark.parametrize(("kind", "archetype"), [("jpeg", "EncodedImage"), ("rgb8", "Image")])
def test_picture_without_successor_fades(show: Callable[..., Any], kind: str, archetype: str) -> None:
    picture = Picture(name="camera", size=(2, 1), format=kind, data=b"\x01\x02\x03\x04\x05\x06")
    taken = {0.5: {"pictures": [picture]}, 1.0: {"pictures": [picture]}, 5.0: {"pictures": [picture]}}
    recording = show({at / 2: {} for at in range(1, 12)} | taken)
    opacity = recording.of("/camera/pictures/camera", f"{archetype}:opacity")
    assert [(t, round(values[0], 1)) for t, values in opacity] == [(2.5 * SECOND, 0.3), (5 * SECOND, 1.0)]
    words = recording.of("/camera/ages/camera", "Points2D:labels")
    assert [(t, values) for t, values in words] == [(2.5 * SECOND, ["as of 1.0 s"]), (5 * SECOND, [])]


def test_of_ten_pictures_a_second_five_are_recorded(show: Callable[..., Any]) -> None:
    picture = Picture(name="camera", size=(2, 1), format="rgb8", data=b"\x01\x02\x03\x04\x05\x06")
    recording = show({at / 10: {"pictures": [picture]} for at in range(10, 20)})
    taken = [t for t, _ in recording.of("/camera/pictures/camera", "Image:buffer")]
    assert taken == pytest.approx([SECOND + k * SECOND // 5 for k in range(5)])


def test_pictures_are_recorded_with_their_detections(show: Callable[..., Any]) -> None:
    jpeg = Picture(name="camera", size=(32, 24), format="jpeg", data=b"\xff\xd8 and so on")
    raw = Picture(name="camera", size=(2, 1), format="rgb8", data=b"\x01\x02\x03\x04\x05\x06")
    found = Detection(picture="camera", name="object", box=(10, 4, 6, 8))
    recording = show(
        {
            1.0: {"pictures": [jpeg], "detections": [found]},
            2.0: {"detections": [found]},
            3.0: {"pictures": [raw], "detections": []},
        }
    )
    assert bytes(recording.of("/camera/pictures/camera", "EncodedImage:blob")[0][1][0]) == jpeg.data
    assert bytes(recording.of("/camera/pictures/camera", "Image:buffer")[0][1][0]) == raw.data
    centers = recording.of("/camera/detections", "Boxes2D:centers")
    assert centers == [(SECOND, [[13.0, 8.0]]), (3 * SECOND, [])]
    assert recording.of("/camera/detections", "Boxes2D:half_sizes")[0][1] == [[3.0, 4.0]]


def test_the_camera_frustum_is_as_wide_as_the_field_of_view(show: Callable[..., Any]) -> None:
    strips = show({0.0: {}}).of("/scene/sight/camera", "LineStrips3D:strips")[0][1]
    rim = np.array(strips[0])
    assert np.ptp(rim[:, 0]) / rim[0, 2] == pytest.approx(32 / 30)
    assert len(strips) == 5


def test_meshes_of_a_frame_are_drawn_as_a_single_surface(show: Callable[..., Any]) -> None:
    corners = float32((0, 0, 0, 1, 0, 0, 0, 1, 0))
    up = float32((0, 0, 1) * 3)
    triangle = np.array([0, 1, 2], "<u4").tobytes()
    shared = {"frame": "base_link", "vertices": corners, "normals": up, "triangles": triangle}
    both = [Mesh(**shared, color=(255, 0, 0, 255)), Mesh(**shared, color=(0, 0, 255, 255))]
    recording = show({0.0: {}}, replace(STATIC, meshes=both))
    entity = "/scene/parts/base_link/mesh"
    assert recording.of(entity, "Mesh3D:triangle_indices")[0][1] == [[0, 1, 2], [3, 4, 5]]
    assert recording.of(entity, "Mesh3D:vertex_colors")[0][1] == [0xFF0000FF] * 3 + [0x0000FFFF] * 3


@pytest.mark.parametrize(
    ("size", "height", "outlines"),
    [
        ((4.0, 0.2, 2.5), 0.4, 0),  # a wall
        ((0.4, 1.0, 1.9), 1.9, 0),  # a bookcase
        ((0.03, 0.4, 1.9), 1.9, 0),  # a board
        ((0.7, 0.7, 2.2), 0.4, 1),  # a pillar
    ],
)
def test_only_walls_and_parts_as_high_as_a_room_are_cut(
    size: tuple[float, float, float], height: float, outlines: int
) -> None:
    part = Box(size=size, position=(0.0, 0.0, size[2] / 2))
    drawings = dict(archetypes([part], around=True))
    assert drawings["box"].half_sizes.as_arrow_array().to_pylist()[0][2] == pytest.approx(height / 2)
    assert len(drawings) == 1 + outlines


def test_the_battery_is_a_curve_and_notes_are_in_the_running_panel(
    run: Callable[..., Any], recorded: Callable[..., Any], tmp_path: Path
) -> None:
    events = run(3)
    t = events[-2].stamp
    moved = MovingSceneEvent(t, t, MovingScene(battery=77.5, notes={"localisation": "sure"}))
    recording = recorded([*events[:-2], moved, *run(4)[-3:-2]], tmp_path / "run.rrd")
    assert recording.of("/battery/level", "Scalars:scalars") == [(t, [77.5])]
    assert "| localisation | sure |" in recording.of("/now", "TextDocument:text")[-1][1][0]


def test_a_robot_without_a_world_is_seen_on_its_whole_map() -> None:
    grid = Grid(name="map", kind="occupancy", resolution=0.5, origin=(-1.0, 2.0), size=(4, 2), cells=bytes(8))
    assert extent([], [grid]) == ((-1.0, 2.0), (1.0, 3.0))
    floor = Box(position=(0.0, 0.0, 0.0), size=(8.0, 6.0, 0.1))
    assert extent([floor], [grid]) == ((-4.0, -3.0), (4.0, 3.0))
    assert extent([]) == ((-3.0, -3.0), (3.0, 3.0))
