"""The robot for ``btcore run``: its options, the body that leaves are given, and what it reports."""

import math
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from btcore_robot.robot import BaseInfo, Pose2D, Robot, Waypoints
from btcore_sim.errors import SimError

if TYPE_CHECKING:
    from btcore_sim.events import EventRunner
    from btcore_sim.run_metrics import RunMetrics
    from btcore_sim.simulated_robot import SimulatedRobot


class RobotExtension:
    """Offers a `Robot` in a simulated world to trees that ask for one; others start no simulator.

    It has every hook of `btcore.run_extension.RunExtension`, and doesn't inherit from it, as the simulator
    imports nothing of btcore.
    """

    used_by: str | None = "leaf that asks for a robot"
    is_fallback: bool = True
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
            ["--start"],
            metavar="random|X,Y,YAW",
            help="Where the robot begins (m, degrees), or a random free place; else by the world's own rule.",
        ),
        click.Option(
            ["--noise"],
            type=click.FloatRange(0.0),
            default=1.0,
            show_default=True,
            metavar="FACTOR",
            help="How noisy laser and odometry are: 0 makes them perfect, 2 twice as bad as the robot's are.",
        ),
        click.Option(
            ["--battery"],
            type=click.FloatRange(0.0, 100.0),
            default=100.0,
            show_default=True,
            metavar="PERCENT",
            help="How full the robot's battery is at the start.",
        ),
        click.Option(
            ["--fault"],
            multiple=True,
            metavar="PART:START-END",
            help="Let laser, odometry, camera or wheel fail between two times (s); repeatable.",
        ),
        click.Option(
            ["--people"],
            type=click.IntRange(min=0),
            default=0,
            show_default=True,
            metavar="N",
            help="People who walk about in the world; they stop before the robot.",
        ),
        click.Option(
            ["--obstacles"],
            type=click.IntRange(min=0),
            default=0,
            show_default=True,
            metavar="N",
            help="Boxes at random places that no map has.",
        ),
        click.Option(
            ["--event"],
            multiple=True,
            metavar="KIND:TIME",
            help="box:30 drops a box before the robot at 30 s, kidnap:60 carries it away; repeatable.",
        ),
    )

    single_run_options: Collection[str] = ("gui",)

    def __init__(self) -> None:
        self._body: SimulatedRobot | None = None
        self._events: EventRunner | None = None
        self._report: dict[str, object] = {}

    def requires(self, wanted: Sequence[type]) -> Sequence[type]:
        """Nothing."""
        return ()

    def provide(
        self, settings: Mapping[str, Any], wanted: Sequence[type], provided: Sequence[object] = ()
    ) -> Sequence[object]:
        """The robot in its world and the world's map, as far as *wanted* has `Robot` and `OccupancyMap`.

        Where somebody else has *provided* a robot there is no simulated one, nor its world's map: who drives
        the real one wants no figures of another. A user's mistake is a `click.UsageError`.
        """
        if any(isinstance(one, Robot) for one in provided):
            return ()
        robot = any(Robot in getattr(kind, "__mro__", ()) for kind in wanted)
        # Whoever wants a map has loaded this module: where it isn't loaded nobody does.
        maps = getattr(sys.modules.get("btcore_robot.navigation.occupancy_map"), "OccupancyMap", None)
        charted = maps is not None and maps in wanted
        if not (robot or charted):
            return ()
        found: list[object] = []
        try:
            if robot:
                self._body, self._events = _make(settings)
                found += [self._body, _waypoints(self._body)]
            if charted:
                found.append(_chart(settings))
        except SimError as mistake:
            raise click.UsageError(str(mistake)) from mistake
        except ModuleNotFoundError as missing:
            raise click.UsageError(
                f"the simulated robot needs the module '{missing.name}'; "
                "you can have it: pip install 'btcore[sim]'"
            ) from missing
        return found

    @contextmanager
    def attach(
        self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]
    ) -> Iterator[None]:
        """Stop the robot when the run ends, however it ends, note how it went, and close the world."""
        body = self._body
        metrics = _metrics(body, resources) if body is not None else None
        try:
            yield
        finally:
            if body is not None and metrics is not None:
                body.stop()
                self._report = {"robot": {**_report(body), **metrics.figures()}}
                if self._events is not None:
                    self._report["events"] = self._events.event_log
                body.world.close()
                self._body = None

    def replace_tree(self, tree: object, resources: Sequence[object], settings: Mapping[str, Any]) -> None:
        """Nothing: the world goes on."""

    def on_interrupt(self) -> None:
        """Nothing: an interrupted run is judged as any other."""

    def report(self) -> dict[str, object]:
        """``{"robot": {"distance_m", "collisions", "grazes", "pose", …}}`` of a run that has ended.

        What else is in it, `RunMetrics.figures` tells.
        With people or events also ``"events"``, a list of what happened, when (s) and where (m).
        """
        return self._report


def _waypoints(body: "SimulatedRobot") -> Waypoints:
    places = body.world.scene.waypoints
    return Waypoints({name: Pose2D(x, y, 0.0) for name, (x, y) in places.items()})


def _chart(settings: Mapping[str, Any]) -> object:
    from btcore_sim.map_rasteriser import rasterise
    from btcore_sim.scene import load_scene

    return rasterise(load_scene(settings.get("world", "arena")))


def _make(settings: Mapping[str, Any]) -> "tuple[SimulatedRobot, EventRunner | None]":
    # Here and not above: a tree without a robot must not load the physics engine.
    from btcore_sim.camera import parse_camera
    from btcore_sim.events import parse_event
    from btcore_sim.faults import parse_fault
    from btcore_sim.robot_description import TIAGO, load_description
    from btcore_sim.scenario import Scenario
    from btcore_sim.scene import load_scene
    from btcore_sim.simulated_robot import SimulatedRobot
    from btcore_sim.start_pose import with_start
    from btcore_sim.world import World, random_generator

    noise = settings.get("noise", 1.0)
    if not math.isfinite(noise):
        raise SimError(f"--noise {noise}: a factor is a number, 0 or greater")
    description = load_description(settings.get("robot") or TIAGO).with_noise(noise)
    _check_rate(settings.get("rate"), description.base)
    camera = parse_camera(settings.get("camera", "off"))
    faults = [parse_fault(text) for text in settings.get("fault", ())]
    events = [parse_event(text) for text in settings.get("event", ())]
    scenario = Scenario(settings.get("people", 0), settings.get("obstacles", 0), events)
    seed = settings.get("seed", 0)
    scene = load_scene(settings.get("world", "arena"))
    start = settings.get("start")
    if start is not None:
        scene = with_start(scene, start, random_generator(seed, "start"), description.base.radius)
    scene = scenario.scene(scene, seed)
    world = World(scene, seed=seed, fast=settings.get("fast", False), gui=settings.get("gui", False))
    level = settings.get("battery", 100.0)
    if math.isnan(level):
        raise SimError("--battery nan: a battery's level is a number from 0 to 100")
    body = SimulatedRobot(world, description, camera=camera, faults=faults, battery=level)
    return body, scenario.begin(world, body, description.base.radius)


def _metrics(body: "SimulatedRobot", resources: Sequence[object]) -> "RunMetrics":
    from btcore_sim.run_metrics import RunMetrics, navigator_among

    return RunMetrics(body, navigator_among(resources))


def _check_rate(rate: float | None, base: BaseInfo) -> None:
    least = 1.0 / base.command_timeout
    if rate is not None and rate < least:
        raise SimError(
            f"--rate {rate:g} is too slow for a tree that drives: the base stops "
            f"{base.command_timeout:g} s after a velocity command, so it "
            f"has to be ticked {least:g} times a second or more"
        )


def _report(body: "SimulatedRobot") -> dict[str, object]:
    pose = body.true_pose()
    return {
        "distance_m": round(body.distance, 4),
        "collisions": body.contacts.collisions,
        "grazes": body.contacts.grazes,
        "pose": {"x": round(pose.x, 4), "y": round(pose.y, 4), "yaw": round(pose.yaw, 4)},
    }
