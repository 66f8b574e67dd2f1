"""The animated picture of the landing page shows what the tree and the robot did."""

import importlib.util
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from btcore import Status

pytest.importorskip("pybullet")
ROOT = Path(__file__).parent.parent.parent
PICTURE = ROOT / "docs/images/bump_and_go.svg"


@pytest.fixture(scope="module")
def module() -> Iterator[ModuleType]:
    """The script, which is not in a package."""
    spec = importlib.util.spec_from_file_location("animated_tree", ROOT / "docs/site/animated_tree.py")
    assert spec is not None
    assert spec.loader is not None
    sys.modules[spec.name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


def keyframes(svg: str, name: str) -> dict[float, str]:
    """The values of an animation, by their percentage of the time."""
    (block,) = re.findall(rf"@keyframes {name} {{(.*)}}$", svg, re.MULTILINE)
    return {float(at): value.strip() for at, value in re.findall(r"([\d.]+)% {([^}]*)}", block)}


def test_a_card_changes_its_colour_at_each_change_of_its_result(module: ModuleType) -> None:
    results = [{1: Status.RUNNING}, {1: Status.RUNNING}, {1: Status.SUCCESS, 4: Status.FAILURE}, {}]
    frames = [module.Frame(of_tick, 0.1 * tick, 0.0, 0.0, 2.0) for tick, of_tick in enumerate(results)]
    svg = module.animate(module.draw_tree(), frames).decode()
    assert keyframes(svg, "n1") == {
        0.0: "fill: var(--running)",
        50.0: "fill: var(--success)",
        75.0: "fill: var(--idle)",
    }
    assert keyframes(svg, "n4") == {
        0.0: "fill: var(--idle)",
        50.0: "fill: var(--failure)",
        75.0: "fill: var(--idle)",
    }
    assert keyframes(svg, "trail")[100.0] == "stroke-dashoffset: 0.000"


def test_the_committed_picture_shows_the_run_of_the_robot(module: ModuleType) -> None:
    frames = module.record_run(4.0)
    assert frames[0].free > 1.0
    svg = PICTURE.read_text(encoding="utf-8")
    # The node Back starts when the wall is less than a metre ahead.
    (tick,) = (number for number, frame in enumerate(frames) if frame.results.get(4) is Status.SUCCESS)
    assert frames[tick].free < 1.0
    changes = [at for at, value in keyframes(svg, "n6").items() if value == "fill: var(--running)"]
    assert changes[0] == pytest.approx(100 * tick / (module.DURATION / module.PERIOD), abs=0.5)
    assert "prefers-reduced-motion" in svg
    assert len(svg) < 60_000
