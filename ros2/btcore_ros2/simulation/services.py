"""The services of the simulator: events, and the figures of the run."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from std_srvs.srv import Trigger

from btcore_ros2.session import RosSession
from btcore_sim.errors import SimError
from btcore_sim.events import EventRunner
from btcore_sim.simulated_robot import SimulatedRobot


def offer_services(
    session: RosSession,
    robot: SimulatedRobot,
    events: EventRunner,
    report: Callable[[], Mapping[str, object]],
) -> None:
    """Create the services of the simulator, all of the type std_srvs/Trigger.

    - `sim/recharge` fills the battery.
    - `sim/reset_contacts` sets the numbers of collisions and grazes to 0.
    - `sim/drop_box` and `sim/kidnap` trigger an event.
    - `sim/summary` returns the figures of the run as JSON.

    Args:
        session: The ROS node.
        robot: The simulated robot.
        events: The runner of the events.
        report: A function that returns the figures of the run.
    """

    def offer(name: str, action: Callable[[], str]) -> None:
        def answer(request: Any, response: Any) -> Any:
            try:
                response.message = action()
                response.success = True
            except SimError as error:
                response.message = str(error)
            return response

        session.node.create_service(Trigger, f"sim/{name}", answer)

    def recharge() -> str:
        robot.recharge()
        return "the battery is full"

    def reset_contacts() -> str:
        robot.contacts.reset()
        return "the numbers of collisions and grazes are 0"

    def drop_box() -> str:
        events.trigger("box")
        return "a box will drop as soon as the robot drives straight and there is a place that it can pass"

    def kidnap() -> str:
        events.trigger("kidnap")
        return "the robot will be carried to another place as soon as it moves"

    def summary() -> str:
        return json.dumps({"time_s": robot.clock.now() / 1e9, **report()})

    for action in (recharge, reset_contacts, drop_box, kidnap, summary):
        offer(action.__name__, action)
