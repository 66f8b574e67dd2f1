"""The services of the simulator: events, and the figures of the run."""

import json
import re
from collections.abc import Callable, Mapping
from typing import Any

from std_srvs.srv import SetBool, Trigger

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
    """Create the services of the simulator, of the type std_srvs/Trigger, except those of doors.

    - `sim/recharge` fills the battery.
    - `sim/reset_contacts` sets the numbers of collisions and grazes to 0.
    - `sim/drop_box`, `sim/kidnap` and `sim/carry` trigger an event at once. If it is not possible, the
      response has `success` false and the reason.
    - `sim/summary` returns the figures of the run as JSON.
    - `sim/doors/NAME` (std_srvs/SetBool) opens or closes a door of the world. A character of its name that
      names of services cannot have is replaced by `_`.

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
        return "a box has dropped in front of the robot"

    def kidnap() -> str:
        events.trigger("kidnap")
        return "the robot has been moved to another place"

    def carry() -> str:
        events.trigger("carry")
        return "the robot is being carried to another place"

    def summary() -> str:
        return json.dumps({"time_s": robot.clock.now() / 1e9, **report()})

    def offer_door(name: str) -> None:
        def answer(request: Any, response: Any) -> Any:
            events.set_door(name, request.data)
            response.success = True
            response.message = f"door '{name}' {'opens' if request.data else 'closes'}"
            return response

        session.node.create_service(SetBool, f"sim/doors/{re.sub('[^A-Za-z0-9_]', '_', name)}", answer)

    for action in (recharge, reset_contacts, drop_box, kidnap, carry, summary):
        offer(action.__name__, action)
    for name in robot.world.scene.doors:
        offer_door(name)
