"""The robot for ``btcore run``: its options, the body that leaves are given, and what it reports."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from robot_nodes.robot import BaseFacts, Robot
from sim.mistakes import SimError

if TYPE_CHECKING:
    from sim.body import Body


class SimMistake(click.ClickException):
    """A mistake in what was asked of the simulator."""

    exit_code = 2


class RobotExtension:
    """Offers a `Robot` in a simulated world to trees that ask for one; others start no simulator."""

    options: Sequence[click.Option] = (
        click.Option(
            ["--world"],
            default="arena",
            show_default=True,
            metavar="NAME",
            help="The robot's world: a name, or a JSON file.",
        ),
        click.Option(["--gui"], is_flag=True, help="Open the physics engine's window."),
        click.Option(
            ["--robot"],
            type=click.Path(path_type=Path),
            metavar="FILE.json",
            help="Another robot than the Tiago, by its description.",
        ),
        click.Option(
            ["--camera"],
            default="320x240@10",
            show_default=True,
            metavar="off|WxH@HZ",
            help="The size and rate of pictures; they are drawn only when a leaf asks for one.",
        ),
        click.Option(
            ["--fault"],
            multiple=True,
            metavar="PART:START-END",
            help="Let laser, odometry, camera or wheel fail between two times (s); repeatable.",
        ),
    )

    def __init__(self) -> None:
        self._body: Body | None = None
        self._report: dict[str, object] = {}

    def provide(self, settings: Mapping[str, Any], wanted: Sequence[type]) -> Sequence[object]:
        """The robot in its world, if a type in *wanted* is `Robot`; a user's mistake is a `SimMistake`."""
        if not any(Robot in getattr(kind, "__mro__", ()) for kind in wanted):
            return ()
        try:
            self._body = _make(settings)
        except SimError as mistake:
            raise SimMistake(str(mistake)) from mistake
        except ModuleNotFoundError as missing:
            raise SimMistake(
                f"the simulated robot needs the module '{missing.name}'; "
                "you can have it: pip install 'btcore[sim]'"
            ) from missing
        return (self._body,)

    @contextmanager
    def attach(
        self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> Iterator[None]:
        """Stop the robot when the run ends, however it ends, note how it went, and close the world."""
        body = self._body
        try:
            yield
        finally:
            if body is not None:
                body.stop()
                self._report = {"robot": _report(body)}
                body.world.close()
                self._body = None

    def report(self) -> dict[str, object]:
        """``{"robot": {"distance_m", "collisions", "grazes", "pose"}}`` of a run that has ended."""
        return self._report


def _make(settings: Mapping[str, Any]) -> "Body":
    # Here and not above: a tree without a robot must not load the physics engine.
    from sim.body import Body
    from sim.camera import parse_camera
    from sim.description import TIAGO, load_description
    from sim.faults import parse_fault
    from sim.scene import load_scene
    from sim.world import World

    description = load_description(settings.get("robot") or TIAGO)
    _check_rate(settings.get("rate"), description.base)
    camera = parse_camera(settings.get("camera", "off"))
    faults = [parse_fault(text) for text in settings.get("fault", ())]
    scene = load_scene(settings.get("world", "arena"))
    world = World(
        scene, seed=settings.get("seed", 0), fast=settings.get("fast", False), gui=settings.get("gui", False)
    )
    return Body(world, description, camera=camera, faults=faults)


def _check_rate(rate: float | None, base: BaseFacts) -> None:
    least = 1.0 / base.command_timeout
    if rate is not None and rate < least:
        raise SimError(
            f"--rate {rate:g} is too slow for a tree that drives: the base stops "
            f"{base.command_timeout:g} s after a velocity command, so it "
            f"has to be ticked {least:g} times a second or more"
        )


def _report(body: "Body") -> dict[str, object]:
    pose = body.true_pose()
    return {
        "distance_m": round(body.distance, 4),
        "collisions": body.contacts.collisions,
        "grazes": body.contacts.grazes,
        "pose": {"x": round(pose.x, 4), "y": round(pose.y, 4), "yaw": round(pose.yaw, 4)},
    }
