"""Screenshots without a display, checked by their pixels."""

import io
import os

import numpy as np
import pytest
from PIL import Image

from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.screenshot import screenshot
from btcore_monitor.screen.sinks import RecordingSinks, ScreenError
from btcore_monitor.screen.style import GROOT, PILL_HEIGHT
from btcore_monitor.screen.tree import TreeView

IDLE, RUNNING, SUCCESS, FAILURE = range(4)
TREE = "Behavior tree"


@pytest.fixture(scope="module")
def vulkan(tmp_path_factory):
    """Skip the test where no picture can be drawn; CI has a driver, and skips nothing."""
    folder = tmp_path_factory.mktemp("probe")
    path = folder / "empty.rrd"
    screen = RobotView(RecordingSinks(save=path))
    screen.show(_one_node())
    screen.close()
    try:
        screenshot(path, folder / "probe.png", size=(640, 480))
    except ScreenError as fault:
        if os.environ.get("CI") == "true" or "graphics driver" not in str(fault):
            raise
        pytest.skip(str(fault))


def _one_node():
    from btcore_monitor.events import ObservedNode, ObservedTree, TreeSeen

    tree = ObservedTree("c" * 32, "One", (ObservedNode(1, "One", "One", "action", "One"),))
    return TreeSeen(tree, 0, 0, {1: IDLE})


@pytest.fixture
def recording(run, tmp_path):
    path = tmp_path / "run.rrd"
    screen = RobotView(RecordingSinks(save=path))
    events = run(70)
    for event in events:
        screen.show(event)
    view = screen.tree
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
    return all(abs(one - other) <= 6 for one, other in zip(seen, rgb(wanted), strict=True))


def test_pills_are_at_the_places_of_the_layout_in_their_current_colours(vulkan, recording, tmp_path):
    path, view = recording
    wanted = {
        2.0: {"bumpgo": GROOT.busy, "Forward": GROOT.fill[RUNNING], "Back": GROOT.fill[IDLE]},
        4.5: {"escape": GROOT.busy, "Back": GROOT.fill[RUNNING], "Forward": GROOT.fill[IDLE]},
        5.5: {"Turn": GROOT.fill[RUNNING], "Back": GROOT.fill[SUCCESS], "clear": GROOT.fill[FAILURE]},
    }
    for t, colours in wanted.items():
        screenshot(path, tmp_path / "tree.png", t=t, view=TREE)
        picture = TreePicture((tmp_path / "tree.png").read_bytes(), view)
        for name, colour in colours.items():
            assert close(picture.at(name), colour), (t, name, picture.at(name), rgb(colour))


def test_the_whole_window_has_the_requested_size(vulkan, recording, tmp_path):
    path, _ = recording
    screenshot(path, tmp_path / "window.png", t=4.5, size=(1280, 800))
    with Image.open(tmp_path / "window.png") as image:
        assert image.size == (1280, 800)


def test_two_pictures_of_the_tree_are_the_same(vulkan, recording, tmp_path):
    """The whole window may differ in the few pixels of a scroll bar, which the viewer fades."""
    path, _ = recording
    first, second = (tmp_path / name for name in ("one.png", "two.png"))
    for picture in (first, second):
        screenshot(path, picture, t=4.5, view=TREE)
    assert first.read_bytes() == second.read_bytes()


def test_the_laser_and_the_trail_are_in_the_scene(vulkan, recording, tmp_path):
    path, _ = recording
    screenshot(path, tmp_path / "scene.png", t=5.0, view="Robot")
    with Image.open(tmp_path / "scene.png") as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    for colour in (GROOT.laser, GROOT.trail):
        assert (np.abs(pixels - rgb(colour)).max(axis=1) <= 6).sum() > 20


def test_an_unknown_view_is_reported_with_the_existing_views(vulkan, recording, tmp_path):
    path, _ = recording
    with pytest.raises(ScreenError, match=r"no view 'Camera'.*Blackboard.*Transitions"):
        screenshot(path, tmp_path / "none.png", view="Camera")


def test_a_missing_recording_is_reported(tmp_path):
    with pytest.raises(ScreenError, match=r"there is no recording .*nowhere\.rrd"):
        screenshot(tmp_path / "nowhere.rrd", tmp_path / "none.png")
