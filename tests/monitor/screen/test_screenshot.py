"""Screenshots without a display, checked by their pixels."""

import io
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb
from PIL import Image
from rerun.experimental import ViewerClient

from btcore_monitor.events import (
    BlackboardEvent,
    ExceptionEvent,
    MovingSceneEvent,
    ObservedNode,
    ObservedTree,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen import screenshot as screenshot_module
from btcore_monitor.screen.font import legible
from btcore_monitor.screen.rerun_process import ScreenError
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.row_buffer import TREE_TIMELINE
from btcore_monitor.screen.screenshot import write_screenshot
from btcore_monitor.screen.sinks import RecordingSinks
from btcore_monitor.screen.style import GROOT, PILL_HEIGHT
from btcore_monitor.screen.tree_view import TreeView
from btcore_scene import Box, Frame, MovingScene, StaticScene

IDLE, RUNNING, SUCCESS, FAILURE = range(4)
SECOND = 10**9
TREE = "Behavior tree"
SMALL = (960, 600)
BOX = Box(
    size=(1, 1, 1), position=(0, 0, 0), quaternion=(0, 0, 0, 1), color=(9, 9, 9, 9), name="箱", frame="車"
)
MONOSPACE = rrb.TextLogFormat(monospace_body=True)


FOREIGN = "Δρόμος", "Ход", "充电", "放电", "بطارية", "🔋", "दौड़", "a\u202eb", "\x07"


def _foreign_events():
    """Return events of a tree whose names, ports, values, notes and errors are in many scripts."""
    nodes = [ObservedNode(1, "🌳", "Sequence", "control", "🌳", 0, tuple(range(2, 2 + 2 * len(FOREIGN), 2)))]
    for at, name in enumerate(FOREIGN):
        sub, uid = 2 + 2 * at, 3 + 2 * at
        nodes.append(ObservedNode(sub, name, "SubTree", "subtree", name, 1, (uid,), {"to": f"{{{name}}}"}))
        nodes.append(ObservedNode(uid, name, name, "action", f"{name}/{name}", sub, (), {}, name))
    tree = ObservedTree("d" * 32, "木", tuple(nodes), {"": "木", **{name: name for name in FOREIGN}})
    yield TreeEvent(tree, 0, 0, {})
    for number, uid in enumerate((1, 2, 3), start=1):
        yield TransitionEvent(number, SECOND, SECOND, 1, uid, IDLE, RUNNING)
    yield BlackboardEvent(SECOND, SECOND, {"": {name: [name] for name in FOREIGN}, FOREIGN[2]: {"x": "電"}})
    yield StaticSceneEvent(StaticScene(frame="地", parts=(BOX,)))
    frames = (Frame("車", "地", (0, 0, 0), (0, 0, 0, 1)), Frame("轮", "地", (1, 0, 0), (0, 0, 0, 1)))
    yield MovingSceneEvent(SECOND, SECOND, MovingScene(stamp=SECOND, frames=frames, notes={"電": "🔋 90 %"}))
    yield ExceptionEvent(SECOND, SECOND, f"{FOREIGN[3]}/{FOREIGN[3]}", "no 電池 🔋")
    yield TickEvent(1, SECOND, SECOND, 1000, RUNNING)


@pytest.fixture(scope="module")
def recording(run: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, TreeView]:
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=path)))
    events = run(70)
    for event in events:
        screen.process_event(event)
    view = screen.tree_view
    screen.close()
    return path, view


class TreePicture:
    """A picture of the tree's view, in which pills are found by the layout."""

    def __init__(self, png: bytes, view: TreeView) -> None:
        self.image = Image.open(io.BytesIO(png)).convert("RGB")
        self.view = view

    def at(self, name: str) -> tuple[int, int, int]:
        """The colour of the pill called *name*, right of the name."""
        index = [node.name for node in self.view.tree.nodes].index(name)
        place = self.view.layout.places[index]
        x0, y0, x1, y1 = self.view.bounds()
        width, height = self.image.size
        scale = min(width / (x1 - x0), height / (y1 - y0))
        middle = (x0 + x1) / 2, (y0 + y1) / 2
        x = width / 2 + (place.x + place.width - PILL_HEIGHT * 0.24 - middle[0]) * scale
        y = height / 2 + (place.y - middle[1]) * scale
        return self.image.getpixel((round(x), round(y)))


def rgb(colour: int) -> tuple[int, int, int]:
    return int(colour) >> 24 & 255, int(colour) >> 16 & 255, int(colour) >> 8 & 255


def close(seen: tuple[int, int, int], wanted: int) -> bool:
    return all(abs(actual - expected) <= 6 for actual, expected in zip(seen, rgb(wanted), strict=True))


def test_pills_have_their_places_and_colours(
    vulkan: None, recording: tuple[Path, TreeView], tmp_path: Path
) -> None:
    path, view = recording
    write_screenshot(path, tmp_path / "tree.png", at=4.5, view=TREE, size=SMALL)
    picture = TreePicture((tmp_path / "tree.png").read_bytes(), view)
    wanted = {"escape": GROOT.busy, "Back": GROOT.fill[RUNNING], "Forward": GROOT.fill[IDLE]}
    for name, colour in wanted.items():
        assert close(picture.at(name), colour), (name, picture.at(name), rgb(colour))


def test_laser_and_trail_are_in_scene(vulkan: None, recording: tuple[Path, TreeView], tmp_path: Path) -> None:
    path, _ = recording
    write_screenshot(path, tmp_path / "scene.png", at=5.0, view="Robot", size=(1280, 800))
    with Image.open(tmp_path / "scene.png") as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    for colour in (GROOT.laser, GROOT.trail):
        assert (np.abs(pixels - rgb(colour)).max(axis=1) <= 6).sum() > 20


def test_texts_in_any_script_are_drawn_in_window_of_requested_size(vulkan: None, tmp_path: Path) -> None:
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=tmp_path / "run.rrd")), find_patterns=["充电"])
    for event in _foreign_events():
        screen.process_event(event)
    view = screen.tree_view
    screen.close()
    write_screenshot(tmp_path / "run.rrd", tmp_path / "window.png", size=(1280, 800))
    with Image.open(tmp_path / "window.png") as image:
        assert image.size == (1280, 800)
        top = np.asarray(image.convert("RGB"), dtype=int)[:28]
    assert (np.ptp(top, axis=2) < 30).all()  # no coloured warnings of rerun above the views
    write_screenshot(tmp_path / "run.rrd", tmp_path / "tree.png", at=1.0, view=TREE, size=SMALL)
    picture = TreePicture((tmp_path / "tree.png").read_bytes(), view)
    assert close(picture.at("🌳"), GROOT.busy)
    assert close(picture.at("放电"), GROOT.fill[IDLE])  # not hidden by another subtree's drawing


def test_every_letter_that_is_not_replaced_can_be_drawn(vulkan: None, tmp_path: Path) -> None:
    letters = "".join(chr(code) for code in range(32, 0x3000) if legible(chr(code)) == chr(code))
    recording = rr.RecordingStream("letters")
    recording.set_sinks(rr.FileSink(tmp_path / "letters.rrd"))
    recording.set_time(TREE_TIMELINE, duration=1.0)
    recording.log("text", rr.TextDocument(letters))
    recording.log("log", rr.TextLog(letters))
    views = rrb.TextDocumentView(origin="text"), rrb.TextLogView(origin="log", format_options=MONOSPACE)
    recording.send_blueprint(rrb.Blueprint(*views, auto_views=False))
    recording.disconnect()
    write_screenshot(tmp_path / "letters.rrd", tmp_path / "letters.png", size=(1280, 800))


def test_a_viewer_that_dies_is_an_error_with_its_reason(vulkan: None, tmp_path: Path) -> None:
    recording = rr.RecordingStream("emoji")
    recording.set_sinks(rr.FileSink(tmp_path / "emoji.rrd"))
    recording.set_time(TREE_TIMELINE, duration=1.0)
    recording.log("text", rr.TextDocument("🔋"))
    recording.send_blueprint(rrb.Blueprint(rrb.TextDocumentView(origin="text"), auto_views=False))
    recording.disconnect()
    with pytest.raises(ScreenError, match=r'failed while it drew the picture: No glyph for "🔋"'):
        write_screenshot(tmp_path / "emoji.rrd", tmp_path / "none.png", size=(640, 480))


def test_requests_that_rerun_ends_too_early_are_repeated_and_equal_pictures_are_equal(
    vulkan: None, recording: tuple[Path, TreeView], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a busy machine, each request may end with rerun's timeout of 15 s before the viewer answers."""
    path, view = recording
    write_screenshot(path, tmp_path / "tree.png", at=5.5, view=TREE, size=SMALL)
    ended = dict.fromkeys(("open", "get_state", "set_time", "take_screenshot"), 0)

    def slow(name: str):
        request = getattr(ViewerClient, name)

        def send(*arguments, **options):
            ended[name] += 1
            if ended[name] <= 2:
                raise TimeoutError("Deadline expired before operation could complete")
            return request(*arguments, **options)

        return send

    for name in ended:
        monkeypatch.setattr(ViewerClient, name, slow(name))
    write_screenshot(path, tmp_path / "again.png", at=5.5, view=TREE, size=SMALL)
    assert min(ended.values()) > 2
    # The whole window may differ in the few pixels of a scroll bar, which the viewer fades.
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "tree.png").read_bytes()
    picture = TreePicture((tmp_path / "again.png").read_bytes(), view)
    wanted = {"Turn": RUNNING, "Back": SUCCESS, "clear": FAILURE}
    for name, status in wanted.items():
        assert close(picture.at(name), GROOT.fill[status]), (name, picture.at(name))


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="a process can't be stopped here")
def test_unresponsive_viewer_is_killed(
    vulkan: None, recording: tuple[Path, TreeView], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screenshot_module, "_ANSWER_TIMEOUT_S", 2.0)

    def draw() -> None:
        with screenshot_module._open_viewer(SMALL) as viewer:
            os.kill(viewer._process._process.pid, signal.SIGSTOP)
            viewer.picture(None)

    with pytest.raises(ScreenError, match=r"did not answer for 2 s, and was killed"):
        draw()


def test_an_unknown_view_is_reported_with_the_existing_views(
    vulkan: None, recording: tuple[Path, TreeView], tmp_path: Path
) -> None:
    path, _ = recording
    with pytest.raises(ScreenError, match=r"no view 'Camera'.*Blackboard.*Transitions"):
        write_screenshot(path, tmp_path / "none.png", view="Camera")


def test_a_missing_recording_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ScreenError, match=r"there is no recording .*nowhere\.rrd"):
        write_screenshot(tmp_path / "nowhere.rrd", tmp_path / "none.png")


RUN = """
<root BTCPP_format="4"><BehaviorTree ID="M"><Sleep msec="500"/></BehaviorTree></root>
"""


def test_a_run_writes_a_picture_of_its_end_or_fails(vulkan: None, tmp_path: Path) -> None:
    tree, picture = tmp_path / "tree.xml", tmp_path / "run.png"
    tree.write_text(RUN)

    def run(**environment: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-m", "btcore", "run", str(tree), "--fast", "--screenshot", str(picture)]
        changed = {**os.environ, **environment}
        return subprocess.run(command, env=changed, capture_output=True, text=True, timeout=200, check=False)

    done = run()
    assert done.returncode == 0, done.stderr
    with Image.open(picture) as image:
        assert image.size == (1920, 1080)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.png", "tree.xml"]
    # Without a driver, the viewer ends.
    done = run(VK_DRIVER_FILES="/nowhere.json", VK_ICD_FILENAMES="/nowhere.json")
    assert done.returncode == 4, done.stderr
    assert re.search(r"error: the viewer \(rerun\) .*: it found no Vulkan driver; on", done.stderr)
    assert f"error: writing {picture}: the monitor's process failed with exit code 2" in done.stderr
    assert "SUCCESS  tree" in done.stderr
