"""A patrol over real sockets: all data for a viewer arrives, and the run is the same without a viewer."""

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import btcore
from btcore.cli.main import main
from btcore_monitor.events import ConnectionEvent, MovingSceneEvent, StaticSceneEvent
from btcore_monitor.serve import serve
from btcore_monitor.watch.feed import Feed

pytest.importorskip("pybullet")

PATROL = ["patrolling", "--world", "house", "--seed", "1", "--json", "--camera", "160x120@5"]


def report(output: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(output.splitlines()[-1])
    del found["real_time_factor"]
    return found


def watched() -> tuple[list[Any], dict[str, Any]]:
    """Return the events of six seconds of a patrol, and the run's report."""
    tree = btcore.loads('<root BTCPP_format="4"><BehaviorTree ID="T"><AlwaysSuccess/></BehaviorTree></root>')
    with serve(tree, groot2_port=0) as publisher:
        port = publisher.port
    with Feed(f":{port}") as feed:
        # In real time: a fast run may end before the viewer connects.
        run = subprocess.Popen(
            [
                *[sys.executable, "-m", "btcore", "run", *PATROL, "--duration", "6"],
                *["--publish", "groot2", "--port", str(port)],
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        events = list(feed.events(until_end=True))
        output, message = run.communicate(timeout=100)
    assert run.returncode == 0, message
    return events, report(output)


def moving(events: list[Any], key: str) -> list[Any]:
    found = [getattr(event.data, key) for event in events if isinstance(event, MovingSceneEvent)]
    return [item for item in found if item]


def test_a_viewer_gets_all_data_of_a_run_that_is_the_same_without_a_viewer() -> None:
    events, reported = watched()
    assert [
        event.detail for event in events if isinstance(event, ConnectionEvent) and event.state == "lost"
    ] == []

    (static,) = [event.data for event in events if isinstance(event, StaticSceneEvent)]
    assert [grid.name for grid in static.grids] == ["map"]
    assert {"wall_west", "base_link"} <= {
        name for part in (*static.parts, *static.meshes) for name in part.name.split("/")
    }
    assert {"wp1", "wp2", "wp3"} <= {place.name for place in static.places}
    assert static.areas

    named = {pose.name for poses in moving(events, "poses") for pose in poses}
    assert named == {"path", "goal", "particles", "estimate", "odometry"}
    grids = {grid.name for grids in moving(events, "grids") for grid in grids}
    assert grids == {"global_costmap", "local_costmap"}
    levels = moving(events, "battery")
    assert levels == sorted(levels, reverse=True)
    assert levels[0] > levels[-1] > 95.0
    assert {notes["localisation"] for notes in moving(events, "notes")} == {"sure"}

    pictures = [picture for several in moving(events, "pictures") for picture in several]
    stamps = [picture.stamp for picture in pictures]
    assert 25 <= len(stamps) == len(set(stamps)) <= 31
    assert {picture.format for picture in pictures} == {"jpeg"}
    boxes = np.array([found[0].box for found in moving(events, "detections")])
    assert len(boxes) > 5
    assert (boxes >= 0).all()
    assert (boxes[:, 0] + boxes[:, 2] <= 160).all()

    unpaced = CliRunner().invoke(main, ["run", *PATROL, "--duration", "6", "--fast"], catch_exceptions=False)
    assert report(unpaced.stdout) == reported
