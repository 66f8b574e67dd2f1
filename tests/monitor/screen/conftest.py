"""Fixtures: the events that a bump-and-go robot would send, and the contents of recordings."""

import math
import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from btcore_monitor.events import (
    BlackboardEvent,
    ConnectionEvent,
    Event,
    MovingSceneEvent,
    ObservedNode,
    ObservedTree,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen.rerun_process import ScreenError, hold_port, port_of
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.row_buffer import TREE_TIMELINE, WALL_TIMELINE
from btcore_monitor.screen.screenshot import write_screenshot
from btcore_monitor.screen.sinks import RecordingSinks
from btcore_scene import Box, Cylinder, Frame, Laser, MovingScene, Scan, Sphere, StaticScene

IDLE, RUNNING, SUCCESS, FAILURE = range(4)
PERIOD = 100_000_000  # ns
WALL = 1_700_000_000 * 10**9  # ns since 1970, the start of the run
ROOT, AVOID, CLEAR, OBSTACLE, ESCAPE, BACK, TURN, FORWARD = range(1, 9)


def bumpgo(tree_id: str = "a" * 32) -> ObservedTree:
    nodes = (
        ObservedNode(ROOT, "bumpgo", "ReactiveSequence", "control", "bumpgo", 0, (AVOID, FORWARD)),
        ObservedNode(AVOID, "avoid", "Fallback", "control", "avoid", ROOT, (CLEAR, ESCAPE)),
        ObservedNode(CLEAR, "clear", "Inverter", "decorator", "clear", AVOID, (OBSTACLE,)),
        ObservedNode(
            OBSTACLE, "IsObstacle", "IsObstacle", "condition", "IsObstacle", CLEAR, (), {"distance": "1.0"}
        ),
        ObservedNode(ESCAPE, "escape", "Sequence", "control", "escape", AVOID, (BACK, TURN)),
        ObservedNode(BACK, "Back", "Back", "action", "Back", ESCAPE),
        ObservedNode(TURN, "Turn", "Turn", "action", "Turn", ESCAPE),
        ObservedNode(FORWARD, "Forward", "Forward", "action", "Forward", ROOT),
    )
    return ObservedTree(tree_id, "BumpGo", nodes, {"": "BumpGo"})


def _changes(tick: int) -> list[tuple[int, int]]:
    """Return (uid, status) of the changes in a tick: 40 ticks forward, 10 back, 10 turning, and again."""
    phase = (tick - 1) % 60
    started = [(AVOID, RUNNING), (CLEAR, RUNNING)]
    if phase < 40:
        checked = [(OBSTACLE, FAILURE), (OBSTACLE, IDLE), (CLEAR, SUCCESS), (CLEAR, IDLE)]
        return [(ROOT, RUNNING), *started, *checked, (AVOID, SUCCESS), (AVOID, IDLE), (FORWARD, RUNNING)]
    if phase == 40:
        checked = [(OBSTACLE, SUCCESS), (OBSTACLE, IDLE), (CLEAR, FAILURE)]
        return [(ROOT, RUNNING), *started, *checked, (ESCAPE, RUNNING), (BACK, RUNNING), (FORWARD, IDLE)]
    if phase == 50:
        return [(BACK, SUCCESS), (TURN, RUNNING)]
    if phase == 59:
        ended = [
            (TURN, SUCCESS),
            (BACK, IDLE),
            (TURN, IDLE),
            (ESCAPE, SUCCESS),
            (ESCAPE, IDLE),
            (CLEAR, IDLE),
        ]
        return [*ended, (AVOID, SUCCESS), (AVOID, IDLE), (FORWARD, RUNNING)]
    return []


def _scene() -> StaticScene:
    wall: dict[str, Any] = {"frame": "map", "quaternion": (0, 0, 0, 1), "color": (120, 130, 148, 255)}
    body: dict[str, Any] = {"frame": "base_link", "position": (0, 0, 0.1), "quaternion": (0, 0, 0, 1)}
    parts = (
        Box(**wall, name="arena/north", size=(6.2, 0.1, 2.4), position=(0, 3.05, 1.2)),
        Box(**wall, name="arena/south", size=(6.2, 0.1, 2.4), position=(0, -3.05, 1.2)),
        Cylinder(**body, name="robot/base", radius=0.27, length=0.3),
        Sphere(**body, name="robot/head", radius=0.1),
    )
    laser = Laser(
        frame="base_laser_link", angle_min=-1.9, angle_increment=3.8 / 99, range_min=0.05, range_max=25.0
    )
    return StaticScene(frame="map", parts=parts, laser=laser, footprint_radius=0.27)


def _moving(tick: int, t: int) -> MovingScene:
    ranges = np.full(100, 2.0 + 0.5 * math.sin(tick / 9), dtype="<f4")
    ranges[:10] = np.inf
    return MovingScene(
        stamp=t,
        frames=(
            Frame("base_link", "map", (0.03 * tick % 2.0, 0.0, 0.1), (0, 0, 0, 1)),
            Frame("base_laser_link", "base_link", (0.2, 0.0, 0.0), (0, 0, 0, 1)),
        ),
        scan=Scan(stamp=t, ranges=ranges.tobytes()),
        velocity=(0.3, 0.0),
        collisions=0,
        grazes=0,
    )


def _run(ticks: int, scene: bool, tree_id: str) -> Iterator[Event]:
    tree = bumpgo(tree_id)
    status = {node.uid: IDLE for node in tree.nodes}
    yield ConnectionEvent("connected", "a script")
    yield TreeEvent(tree, 0, WALL, dict(status))
    if scene:
        yield StaticSceneEvent(_scene())
    number = 0
    for tick in range(1, ticks + 1):
        t = tick * PERIOD
        for uid, new in _changes(tick):
            if status[uid] != new:
                number += 1
                yield TransitionEvent(number, t, WALL + t, tick, uid, status[uid], new)
                status[uid] = new
        yield TickEvent(tick, t, WALL + t, 150_000 + 1_000 * (tick % 7), RUNNING)
        if tick % 5 == 0:
            yield BlackboardEvent(t, WALL + t, {"": {"bumps": tick // 60, "goal": None}})
        if scene:
            yield MovingSceneEvent(t, WALL + t, _moving(tick, t))
    yield ConnectionEvent("ended", "")


@pytest.fixture(scope="session")
def run() -> Callable[..., Any]:
    """``run(ticks, scene=True, tree_id=…)``: the events of a bump-and-go run at 10 Hz."""

    def events(ticks: int, scene: bool = True, tree_id: str = "a" * 32) -> list[Event]:
        return list(_run(ticks, scene, tree_id))

    return events


class Recording:
    """Rows of an .rrd by entity and component: (time in ns or None if static, values), in order of time.

    A column is converted when it is first read, because converting all of them is slow.
    """

    def __init__(self, path: Path) -> None:
        self._batches = defaultdict(list)
        for chunk in RrdReader(path).stream():
            batch = chunk.to_record_batch()
            for name in batch.schema.names:
                if name not in ("rerun.controls.RowId", TREE_TIMELINE, WALL_TIMELINE):
                    self._batches[str(chunk.entity_path), name].append(batch)
        self.columns = self._batches.keys()
        self._rows: dict[tuple[str, str], list[tuple[int | None, list]]] = {}

    def of(self, entity: str, component: str) -> list[tuple[int, list]]:
        key = entity, component
        if key not in self._rows:
            rows = []
            for batch in self._batches.get(key, ()):
                values = batch.column(component).to_pylist()
                times = [None] * len(batch)
                if TREE_TIMELINE in batch.schema.names:
                    times = batch.column(TREE_TIMELINE).cast("int64").to_pylist()
                rows += [row for row in zip(times, values, strict=True) if row[1] is not None]
            self._rows[key] = sorted(rows, key=lambda row: row[0] if row[0] is not None else -1)
        return self._rows[key]

    def at(self, entity: str, component: str, t: int) -> list:
        """The latest value at time *t*."""
        return [values for time, values in self.of(entity, component) if time <= t][-1]

    def lane(self, name: str) -> str:
        return next(entity for entity, _ in self.columns if entity.endswith(f"_{name}"))


@pytest.fixture(scope="session")
def read() -> type:
    """``read(path)``: a recording's rows."""
    return Recording


@pytest.fixture(scope="session")
def recorded() -> Callable[..., Any]:
    """``recorded(events, path, …)``: the rows of the recording that the screen makes of *events*.

    Further arguments are the screen's.
    """

    def record(events: list[Event], path: Path, **look: Any) -> Recording:
        screen = RobotView(SingleRobotLayout(RecordingSinks(save=path)), **look)
        for event in events:
            screen.process_event(event)
        screen.close()
        assert screen.files == [path]
        return Recording(path)

    return record


def _big_tree(count: int) -> ObservedTree:
    """A root over subtrees of a Sequence with eight leaves each, *count* nodes in all."""
    nodes: list[dict[str, Any]] = []

    def add(name: str, kind: Any, parent: int, subtree: str) -> int:
        uid = len(nodes) + 1
        node = {"uid": uid, "name": name, "id": name, "type": kind, "path": f"{subtree}/{name}"}
        nodes.append({**node, "parent": parent, "children": (), "subtree": subtree})
        if parent:
            nodes[parent - 1]["children"] += (uid,)
        return uid

    root = add("Day", "control", 0, "")
    while len(nodes) < count:
        task = add(f"Task{len(nodes)}", "subtree", root, "")
        path = f"Task{task}"
        steps = add("Steps", "control", task, path) if len(nodes) < count else 0
        for _ in range(min(8, count - len(nodes))):
            add(f"Leaf{len(nodes)}", "action", steps, path)
    return ObservedTree("e" * 32, "Day", tuple(ObservedNode(**node) for node in nodes), {"": "Day"})


@pytest.fixture
def big_tree() -> Callable[..., Any]:
    """``big_tree(count)``: a tree of *count* nodes, in subtrees of ten."""
    return _big_tree


@pytest.fixture(scope="session")
def free_port() -> Callable[[], int]:
    """``free_port()``: a port at which no program listens."""

    def free_port() -> int:
        with hold_port() as held:
            return port_of(held)

    return free_port


@pytest.fixture(scope="session")
def vulkan(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Skip the test where no picture can be drawn; CI has a driver, and skips nothing."""
    if os.environ.get("CI") == "true":
        return
    folder = tmp_path_factory.mktemp("probe")
    path = folder / "empty.rrd"
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=path)))
    screen.process_event(_one_node())
    screen.close()
    try:
        write_screenshot(path, folder / "probe.png", size=(640, 480))
    except ScreenError as error:
        if "Vulkan driver" not in str(error):
            raise
        pytest.skip(str(error))


def _one_node() -> TreeEvent:
    tree = ObservedTree("c" * 32, "One", (ObservedNode(1, "One", "One", "action", "One"),))
    return TreeEvent(tree, 0, 0, {1: IDLE})


def _blueprints(path: Path) -> list[dict[str, list[Any]]]:
    reader = RrdReader(path)
    sent = []
    for store in reader.blueprints():
        values: dict[str, list[Any]] = defaultdict(list)
        logged = 0
        for chunk in reader.stream(store=store):
            batch = chunk.to_record_batch()
            if "log_time" in batch.schema.names:
                logged = max(logged, *batch.column("log_time").cast("int64").to_pylist())
            for name in batch.schema.names:
                if ":" in name:
                    values[name] += [row for row in batch.column(name).to_pylist() if row]
        sent.append((logged, values))
    return [values for _, values in sorted(sent, key=lambda entry: entry[0])]


@pytest.fixture
def blueprints() -> Callable[..., Any]:
    """``blueprints(path)``: component → values, of each blueprint in the order of sending."""
    return _blueprints
