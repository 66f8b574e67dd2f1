"""What open pages of a preview are sent when the file or the running tree changes."""

import json
from collections.abc import Sequence
from queue import Queue
from typing import Any

from btcore.errors import BtcoreError
from btcore_monitor.events import ObservedNode
from btcore_monitor.preview_extension import RobotState
from btcore_studio.preview.session import PreviewSession
from btcore_studio.preview.tree_reading import TreeFile

NODES = (
    ObservedNode(1, "Küche <img src=x onerror=alert(1)>", "Sequence", "control", ""),
    ObservedNode(2, "Rover", "Rover", "action", "", parent=1),
)


class FakeRobot:
    """A connection whose states a test determines."""

    def __init__(self) -> None:
        self.states: Queue[RobotState] = Queue()
        self.calls: Queue[Any] = Queue()

    def poll(self, timeout: float) -> RobotState:
        return self.states.get(timeout=90)

    def set_breakpoints(self, uids: Sequence[int]) -> None:
        self.calls.put(list(uids))

    def release(self) -> None:
        self.calls.put("release")

    def close(self) -> None:
        self.calls.put("close")


def test_page_keeps_the_last_picture_while_the_file_is_broken(tree_file: TreeFile) -> None:
    text = tree_file.path.read_text(encoding="utf-8")
    session = PreviewSession(tree_file)
    events = session.events()
    picture = session.drawing(None, ())
    name, data = next(events) or ("", {})
    assert (name, data["drawable"], data["trees"]) == ("document", True, ["Visit", "Rounds"])
    tree_file.path.write_text(text.replace("</Sequence>", ""), encoding="utf-8")
    session.reload()
    _, data = next(events) or ("", {})
    assert not data["drawable"]
    assert [item["code"] for item in data["diagnostics"]] == ["E002"]
    assert session.drawing(None, ()) == picture
    tree_file.path.write_text(text.replace("tempo", "speed"), encoding="utf-8")
    session.reload()
    _, data = next(events) or ("", {})
    assert data["drawable"]
    assert b"{speed}" in session.drawing(None, ())


def test_unsaved_text_takes_the_place_of_the_file(tree_file: TreeFile) -> None:
    session = PreviewSession(tree_file)
    session.show_text(tree_file.path.read_text(encoding="utf-8").replace("Rover", "Rocket"))
    session.reload()
    assert b"Rocket" in session.drawing(None, ())
    session.show_text(None)
    assert b"Rocket" not in session.drawing(None, ())


def test_page_sees_the_running_tree_and_sets_breakpoints(tree_file: TreeFile) -> None:
    robot = FakeRobot()
    session = PreviewSession(tree_file, lambda address: robot)
    events = session.events()
    next(events)
    keys = [node["key"] for node in json.loads(session.drawing(None, ()))["nodes"][:2]]
    session.set_breakpoints([keys[1], "of no node"])
    session.watch("somewhere")
    state = RobotState("connected", "", NODES, {1: 1, 2: 3}, {2: 3}, (("", "tempo", "3"),))
    robot.states.put(state)
    assert robot.calls.get(timeout=90) == [2]
    robot.states.put(state._replace(breakpoints=frozenset({2}), stopped_at=2))
    while True:
        name, data = next(events) or ("", {})
        if name == "live" and data["stopped"]:
            break
    assert (data["statuses"], data["results"], data["entries"]) == ("13", "03", state.entries)
    assert data["stopped"] == data["breakpoints"][0] == keys[1]
    session.release()
    robot.states.put(state)
    assert robot.calls.get(timeout=90) == "release"
    robot.states.put(state)
    session._ended.set()  # type: ignore[union-attr]
    robot.states.put(state)
    session.close()
    assert robot.calls.get(timeout=90) == "close"


def test_page_shows_why_the_tree_can_never_be_watched(tree_file: TreeFile) -> None:
    class Refused(FakeRobot):
        def poll(self, timeout: float) -> RobotState:
            raise BtcoreError("the robot does not know this key")

    session = PreviewSession(tree_file, lambda address: Refused())
    events = session.events()
    session.watch("somewhere")
    while True:
        name, data = next(events) or ("", {})
        if name == "live" and data["detail"]:
            break
    assert (data["connection"], data["detail"]) == ("lost", "the robot does not know this key")
    session.close()
