"""Draw the animated picture of the landing page: bump-and-go's tree and its robot.

``python docs/site/animated_tree.py docs/images/bump_and_go.svg`` runs the tree on the simulated robot and
writes an SVG animated by CSS. The picture is dark or light, as the reader's system is set, and stands still
if the reader's system is set to reduced motion.
"""

import itertools
import math
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from lxml import etree

import btcore
from btcore import Status
from btcore.testing import Harness
from btcore_robot import leaves
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

TREE: Final = "bumpgo"
DURATION: Final = 30.0
"""Duration of the run (s)."""
PERIOD: Final = 0.1
"""Time between two ticks (s)."""
SPEED: Final = 2.5
"""Speed of the animation, as a multiple of the robot's speed."""
STILL: Final = 14.0
"""Time (s) of the run that the picture shows without animation."""

_SVG: Final = "{http://www.w3.org/2000/svg}"
_ARENA: Final = 300.0  # px
_HALF: Final = 3.1  # from the arena's middle to the outside of its walls, in m
_SCALE: Final = _ARENA / (2 * _HALF)
_FLOOR: Final = 372.0  # height of the picture, in px
_STYLE: Final = """
    :root { --page: #ffffff; --ink: #1b2330; --dim: #6a7485; --line: #a9b2c1; --floor: #eef1f6;
            --wall: #8a94a6; --idle: #ffffff; --running: #ffdc9c; --success: #b9ebc6; --failure: #ffc4bd; }
    @media (prefers-color-scheme: dark) {
      :root { --page: #12161d; --ink: #f1f4f8; --dim: #98a2b3; --line: #566072; --floor: #1b212b;
              --wall: #6b7687; --idle: #232a36; --running: #a55f05; --success: #23703a; --failure: #a12f2f; }
    }
    .page { fill: var(--page); }
    text, text.name { fill: var(--ink); }
    text.about, text.uid, .port .dim { fill: var(--dim); }
    .port .value { fill: var(--ink); }
    .edge { stroke: var(--line); }
    .rule { stroke: var(--line); stroke-opacity: .5; }
    .floor { fill: var(--floor); stroke: var(--wall); stroke-width: 5; }
    .trail { fill: none; stroke: #f08c0c; stroke-width: 2; stroke-opacity: .6; stroke-dasharray: 1; }
    .beam { stroke: #22a5bd; stroke-width: 2; }
    .robot { fill: #2f66c8; stroke: var(--page); stroke-width: 1.5; }
    .nose { fill: #ffffff; }
    .moving { animation-duration: LOOPs; animation-iteration-count: infinite; }
    .moving { animation-timing-function: linear; }
    .card { animation-timing-function: step-end; }
    @media (prefers-reduced-motion: reduce) { .moving { animation: none !important; } }
"""


@dataclass(frozen=True, slots=True)
class Frame:
    """The state after a tick.

    Attributes:
        results: The last result of each ticked node, by uid.
        x: The robot's position in the world (m).
        y: The robot's position in the world (m).
        yaw: The robot's direction (rad).
        free: The distance (m) that the laser measures ahead.
    """

    results: dict[int, Status]
    x: float
    y: float
    yaw: float
    free: float


def record_run(seconds: float = DURATION) -> list[Frame]:
    """Run the tree on the simulated robot and return the states after each tick."""
    world = World(load_world_description("arena"), seed=2)
    robot = SimulatedRobot(world)
    nodes = btcore.Registry.standard()
    nodes.add_plugin(leaves)
    harness = Harness.load(f"trees/{TREE}.xml", nodes=nodes, resources=[robot], clock=world)
    uids = {node.path: node.uid for node in harness.tree}
    frames = []
    for _ in range(round(seconds / PERIOD)):
        harness.tick()
        scan, pose = robot.scan(), robot.true_pose()
        free = scan.ranges[len(scan.ranges) // 2] if scan is not None else 0.0
        results = {uids[path]: results[-1] for path, results in harness.last.results.items()}
        frames.append(Frame(results, pose.x, pose.y, pose.yaw, float(free)))
        harness.tree.sleep(PERIOD)
    harness.halt()
    world.close()
    return frames


def draw_tree() -> etree._Element:
    """Return the drawing of the tree by ``btcore show --svg``."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "tree.svg"
        subprocess.run([sys.executable, "-m", "btcore", "show", TREE, "--svg", str(file)], check=True)
        return etree.parse(file, etree.XMLParser(remove_blank_text=True)).getroot()


def animate(drawing: etree._Element, frames: Sequence[Frame]) -> bytes:
    """Return the SVG of a tree's *drawing* beside the robot, animated by *frames*."""
    cards = drawing.find(f"{_SVG}g")
    assert cards is not None
    width = float(drawing.get("viewBox", "").split()[2])
    for part in list(drawing):
        if part is not cards and part.tag != f"{_SVG}style":
            drawing.remove(part)
    rules = [_STYLE.replace("LOOP", f"{len(frames) * PERIOD / SPEED:g}")]
    for card in cards.iter(f"{_SVG}rect"):
        group = card.getparent()
        assert group is not None
        for tooltip in group.findall(f"{_SVG}title"):
            group.remove(tooltip)  # pictures in pages have no tooltips
        uid = int(group.findtext(f"{_SVG}text[@class='uid']", ""))
        card.set("class", f"{card.get('class')} moving n{uid}")
        rules.append(_status_rules(uid, frames))
    style = drawing.find(f"{_SVG}style")
    assert style is not None
    style.text = (style.text or "") + "".join([*rules, *_robot_rules(frames)])
    cards.set("transform", "translate(20 24)")
    for name, value in (("width", width + _ARENA), ("height", _FLOOR)):
        drawing.set(name, f"{value:.0f}")
    drawing.set("viewBox", f"0 0 {width + _ARENA:.0f} {_FLOOR:.0f}")
    about = "The tree bump-and-go beside its robot in an arena; nodes change their colours by their results"
    drawing.insert(0, etree.fromstring(f'<title xmlns="{_SVG[1:-1]}">{about}</title>'))
    drawing.insert(
        2, etree.fromstring(f'<rect xmlns="{_SVG[1:-1]}" class="page" width="100%" height="100%"/>')
    )
    drawing.append(_arena(frames, width - 20))
    drawing.append(_legend())
    etree.indent(drawing, "")
    return etree.tostring(drawing, encoding="utf-8") + b"\n"


def _status_rules(uid: int, frames: Sequence[Frame]) -> str:
    """Return the CSS of a card: its colour without animation, and its colour at each change."""

    def fill(frame: Frame) -> str:
        return f"fill: var(--{frame.results.get(uid, Status.IDLE).name.lower()})"

    steps = [
        f"{100 * number / len(frames):.2f}% {{ {fill(frame)} }}"
        for number, frame in enumerate(frames)
        if number == 0 or fill(frame) != fill(frames[number - 1])
    ]
    still = frames[min(round(STILL / PERIOD), len(frames) - 1)]
    return (
        f".n{uid} {{ {fill(still)}; animation-name: n{uid}; }}\n@keyframes n{uid} {{ {' '.join(steps)} }}\n"
    )


def _robot_rules(frames: Sequence[Frame]) -> list[str]:
    """Return the CSS that moves the robot, its laser beam and its trail."""
    still = min(round(STILL / PERIOD), len(frames) - 1)
    passed, turned = [0.0], [frames[0].yaw]
    for before, after in itertools.pairwise(frames):
        passed.append(passed[-1] + math.dist((before.x, before.y), (after.x, after.y)))
        turned.append(turned[-1] + math.remainder(after.yaw - before.yaw, math.tau))

    def values(number: int) -> dict[str, str]:
        frame = frames[number]
        x, y, turn = frame.x * _SCALE, -frame.y * _SCALE, -math.degrees(turned[number])
        return {
            "robot": f"transform: translate({x:.1f}px,{y:.1f}px) rotate({turn:.1f}deg)",
            "beam": f"transform: scaleX({frame.free * _SCALE:.1f})",
            "trail": f"stroke-dashoffset: {1 - passed[number] / (passed[-1] or 1.0):.3f}",
        }

    numbers = [*range(0, len(frames), 2), len(frames) - 1]
    rules = []
    for part, value in values(still).items():
        steps = [
            f"{100 * number / (len(frames) - 1):.2f}% {{ {values(number)[part]} }}" for number in numbers
        ]
        rules.append(
            f"#{part} {{ {value}; animation-name: {part}; }}\n@keyframes {part} {{ {' '.join(steps)} }}\n"
        )
    return rules


def _arena(frames: Sequence[Frame], left: float) -> etree._Element:
    """Return the drawing of the arena, seen from above, with the robot."""
    points = " ".join(f"{frame.x * _SCALE:.1f},{-frame.y * _SCALE:.1f}" for frame in frames[::2])
    half, size = 3.0 * _SCALE, 6.0 * _SCALE
    return _element(
        f'<g transform="translate({left + _ARENA / 2:.1f} {24 + _ARENA / 2:.1f})">'
        f'<rect class="floor" x="{-half:.1f}" y="{-half:.1f}" width="{size:.1f}" height="{size:.1f}"/>'
        f'<polyline id="trail" class="trail moving" pathLength="1" points="{points}"/>'
        '<g id="robot" class="moving">'
        '<line id="beam" class="beam moving" x2="1" vector-effect="non-scaling-stroke"/>'
        f'<circle class="robot" r="{0.27 * _SCALE:.1f}"/><path class="nose" d="M10 0L-6-6.5L-2.5 0L-6 6.5Z"/>'
        "</g></g>"
    )


def _legend() -> etree._Element:
    """Return the legend of the statuses."""
    words = ""
    for number, name in enumerate(("running", "success", "failure", "idle")):
        x = 20 + 110 * number
        words += (
            f'<rect x="{x}" y="{_FLOOR - 34:.0f}" width="16" height="16" rx="4" stroke="#8a94a6" '
            f'style="fill: var(--{name})"/>'
            f'<text class="about" x="{x + 24}" y="{_FLOOR - 21:.0f}">{name.upper()}</text>'
        )
    return _element(f"<g>{words}</g>")


def _element(text: str) -> etree._Element:
    """Return an SVG element and its content."""
    return etree.fromstring(f'<svg xmlns="{_SVG[1:-1]}">{text}</svg>')[0]


def main() -> None:
    """Write the picture to the file that the command line names."""
    Path(sys.argv[1]).write_bytes(animate(draw_tree(), record_run()))


if __name__ == "__main__":
    main()
