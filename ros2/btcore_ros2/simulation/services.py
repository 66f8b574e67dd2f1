"""The services of the simulator: events, and the figures of the run."""

import json
import re
from collections.abc import Callable
from typing import Any

from std_srvs.srv import SetBool, Trigger

from btcore_ros2.session import RosSession
from btcore_sim.errors import SimError
from btcore_sim.simulation import Simulation


def offer_services(session: RosSession, simulated: Simulation) -> None:
    """Create the services of the simulator, of the type std_srvs/Trigger, except those of doors.

    - `sim/recharge` fills the battery.
    - `sim/reset_contacts` sets the numbers of collisions and grazes to 0.
    - `sim/drop_box`, `sim/kidnap` and `sim/carry` trigger an event at once.
    - `sim/summary` returns the figures of the run as JSON.
    - `sim/doors/NAME` (std_srvs/SetBool) opens or closes a door of the world. A character of its name that
      names of services cannot have is replaced by `_`.

    If an event is not possible, the response has `success` false and the reason.

    Args:
        session: The ROS node.
        simulated: The simulated robot, in a world with events.
    """
    robot, events = simulated.robot, simulated.events
    assert events is not None

    def offer(service_type: Any, name: str, action: Callable[[Any], str]) -> None:
        def answer(request: Any, response: Any) -> Any:
            try:
                response.message = action(request)
                response.success = True
            except SimError as error:
                response.message = str(error)
            return response

        session.node.create_service(service_type, f"sim/{name}", answer)

    def recharge(_: Trigger.Request) -> str:
        robot.recharge()
        return "the battery is full"

    def reset_contacts(_: Trigger.Request) -> str:
        robot.contacts.reset()
        return "the numbers of collisions and grazes are 0"

    def drop_box(_: Trigger.Request) -> str:
        events.trigger("box")
        return "a box has dropped in front of the robot"

    def kidnap(_: Trigger.Request) -> str:
        events.trigger("kidnap")
        return "the robot has been moved to another place"

    def carry(_: Trigger.Request) -> str:
        events.trigger("carry")
        return "the robot is being carried to another place"

    def summary(_: Trigger.Request) -> str:
        return json.dumps({"time_s": robot.clock.now() / 1e9, **simulated.report()})

    def offer_door(name: str) -> None:
        def set_door(request: SetBool.Request) -> str:
            events.set_door(name, request.data)
            return f"door '{name}' {'opens' if request.data else 'closes'}"

        offer(SetBool, f"doors/{re.sub('[^A-Za-z0-9_]', '_', name)}", set_door)

    for action in (recharge, reset_contacts, drop_box, kidnap, carry, summary):
        offer(Trigger, action.__name__, action)
    for name in robot.world.description.doors:
        offer_door(name)
