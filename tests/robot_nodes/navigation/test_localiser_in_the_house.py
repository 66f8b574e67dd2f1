"""The localiser of the simulated Tiago in its house: physics, laser noise, odometry errors and kidnapping."""

import math
import threading
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("pybullet")

from btcore_navigation.localiser import Localiser
from btcore_robot.robot import Phase, Pose2D
from btcore_robot.transforms import FrameBroadcaster, TransformTree
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

STEP = 100_000_000


class HouseRig:
    """A localiser on the schedule of a simulated robot in the house."""

    def __init__(self, world: World) -> None:
        self.body = SimulatedRobot(world)
        tree = TransformTree()
        frames = FrameBroadcaster(self.body, tree)
        self.localiser = Localiser(self.body, rasterise(world.description), tree, np.random.default_rng(1))
        self.body.schedule.add_task(FrameBroadcaster.RATE, Phase.TRANSFORMS, frames.step)
        self.body.schedule.add_task(self.body.laser_info.rate, Phase.LOCALISER, self.localiser.step)

    def drive(self, v: float, w: float, seconds: float):
        """Drive with a velocity; return the errors (m, rad) at 10 Hz."""
        errors = []
        for _ in range(round(seconds * 10)):
            self.body.drive(v, w)
            self.body.clock.wait_until(self.body.clock.now() + STEP, threading.Event())
            errors.append(self.error())
        return np.array(errors)

    def error(self):
        reported, true = self.localiser.pose(), self.body.true_pose()
        return math.hypot(reported.x - true.x, reported.y - true.y), abs(
            math.remainder(reported.yaw - true.yaw, math.tau)
        )


@pytest.fixture
def rig() -> Iterator[HouseRig]:
    world = World(load_world_description("house"), seed=3)
    yield HouseRig(world)
    world.close()


def test_the_pose_is_accurate_to_centimetres(rig: HouseRig) -> None:
    errors = np.concatenate(
        [rig.drive(*leg) for leg in ((0.0, 0.5, 13.0), (0.3, 0.0, 3.0), (0.2, 0.5, 13.0), (0.0, -0.5, 6.0))]
    )
    assert rig.localiser.is_confident
    assert np.median(errors[:, 0]) < 0.05
    assert errors[:, 0].max() < 0.15
    assert errors[:, 1].max() < 0.08


def test_kidnapping_is_noticed_and_the_pose_is_found_again(rig: HouseRig) -> None:
    rig.drive(0.3, 0.0, 3.0)
    rig.body.kidnap(Pose2D(-5.3, -8.85, 2.0))
    rig.drive(0.0, 0.0, 0.5)
    assert not rig.localiser.is_confident
    for _ in range(60):
        rig.drive(0.0, 0.5 if rig.localiser.is_searching else 0.0, 0.5)
        if rig.localiser.is_confident:
            break
    assert rig.localiser.is_confident
    assert rig.error()[0] < 0.1
