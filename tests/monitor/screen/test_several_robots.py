"""Several robots in one window: side by side, with one timeline and one file, and separate entities."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from btcore_monitor.events import ObservedNode, ObservedTree, TransitionEvent, TreeEvent
from btcore_monitor.screen.robot_layouts import SharedLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.row_buffer import WALL_TIMELINE
from btcore_monitor.screen.sinks import RecordingSinks

SECOND = 10**9


def shown(path: Path, *runs: tuple[str, list]) -> SharedLayout:
    """Show each run's events in its own slot, alternating between the runs."""
    together = SharedLayout(RecordingSinks(save=path), [label for label, _ in runs])
    screens = [RobotView(slot) for slot in together.slots]
    for turn in range(max(len(events) for _, events in runs)):
        for screen, (_, events) in zip(screens, runs, strict=True):
            if turn < len(events):
                screen.process_event(events[turn])
    for screen in screens:
        screen.close()
    together.close()
    return together


def seen(tree_id: str, name: str, t: int, wall: int) -> TreeEvent:
    nodes = (
        ObservedNode(1, "root", "Sequence", "control", "root", 0, (2,)),
        ObservedNode(2, "Go", "Go", "action", "Go", 1),
    )
    return TreeEvent(ObservedTree(tree_id * 32, name, nodes, {"": name}), t, wall, {1: 0, 2: 0})


def test_all_robots_are_in_one_file_and_each_has_its_own_entities(
    run: Callable[..., Any], read: type, tmp_path: Path
) -> None:
    path = tmp_path / "two.rrd"
    together = shown(path, ("arm 1", run(30)), ("robot.local", run(60, tree_id="b" * 32)))
    assert together.files == [path]
    rows = read(path)
    assert len(rows.of("/arm_1/tick/duration", "Scalars:scalars")) == 30
    assert len(rows.of("/robot_local/tick/duration", "Scalars:scalars")) == 60
    assert {entity.split("/")[1] for entity, _ in rows.columns} == {"arm_1", "robot_local", "__properties"}


def test_frames_with_the_same_name_stay_separate(run: Callable[..., Any], read: type, tmp_path: Path) -> None:
    path = tmp_path / "two.rrd"
    shown(path, ("a", run(3)), ("b", run(3, tree_id="b" * 32)))
    rows = read(path)
    for place in ("a", "b"):
        moved = {
            component: rows.of(f"/{place}/scene/frames/base_link", f"Transform3D:{component}")[0][1]
            for component in ("child_frame", "parent_frame")
        }
        assert moved == {"child_frame": [f"{place}/base_link"], "parent_frame": [f"{place}/map"]}
    named = {
        name
        for entity, component in rows.columns
        if component == "CoordinateFrame:frame"
        for _, frames in rows.of(entity, component)
        for name in frames
    }
    assert {name.split("/")[0] for name in named} == {"a", "b"}


def test_window_has_overview_tab_for_each_robot_and_wall_time(
    blueprints: Callable[..., Any], run: Callable[..., Any], tmp_path: Path
) -> None:
    path = tmp_path / "two.rrd"
    shown(path, ("arm", run(3, scene=False)), ("base", run(3, scene=False, tree_id="b" * 32)))
    window = blueprints(path)[-1]
    assert window["TimePanelBlueprint:timeline"] == [[WALL_TIMELINE]]
    tabs = {name for (name,) in window["ContainerBlueprint:display_name"]}
    assert tabs == {"All robots", "arm · BumpGo", "base · BumpGo"}
    origins = [origin for (origin,) in window["ViewBlueprint:space_origin"]]
    # side by side, and in its own tab
    assert origins.count("arm/tree") == origins.count("base/tree") == 2
    assert {origin.split("/")[0] for origin in origins} <= {"arm", "base", ""}


def test_restarted_robot_gets_new_entities_and_tab_for_earlier_tree(
    blueprints: Callable[..., Any], read: type, tmp_path: Path
) -> None:
    path = tmp_path / "two.rrd"
    before = [seen("a", "Old", 0, SECOND), TransitionEvent(1, SECOND, 2 * SECOND, 1, 2, 0, 1)]
    after = [seen("c", "New", 0, 3 * SECOND), TransitionEvent(1, SECOND, 4 * SECOND, 1, 2, 0, 2)]
    shown(path, ("arm", before + after), ("base", [seen("b", "Base", 0, SECOND)]))
    rows = read(path)
    for place, line in (("arm", "IDLE → RUNNING"), ("arm_2", "IDLE → SUCCESS")):
        (text,) = [values[0] for _, values in rows.of(f"/{place}/log", "TextLog:text")]
        assert text.endswith(line)
    tabs = {name for (name,) in blueprints(path)[-1]["ContainerBlueprint:display_name"]}
    assert tabs == {"All robots", "arm · New", "base · Base", "arm · Old, earlier"}


def test_labels_with_the_same_entity_name_get_separate_entities(read: type, tmp_path: Path) -> None:
    path = tmp_path / "two.rrd"
    shown(path, ("a.b", [seen("a", "T", 0, 0)]), ("a:b", [seen("b", "T", 0, 0)]))
    assert {f"/{place}/tree/edges" for place in ("a_b", "a_b_2")} <= {
        entity for entity, _ in read(path).columns
    }


def test_without_a_tree_there_is_no_file(tmp_path: Path) -> None:
    together = shown(tmp_path / "two.rrd", ("a", []), ("b", []))
    assert together.files == []
    assert list(tmp_path.iterdir()) == []
