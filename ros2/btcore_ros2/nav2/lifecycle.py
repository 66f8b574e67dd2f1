"""The lifecycle of Nav2's nodes: their states as services, and Nav2's lifecycle managers."""

from collections.abc import Callable, Mapping
from typing import Any, Final

from lifecycle_msgs.srv import ChangeState, GetState
from std_srvs.srv import Trigger

from btcore_robot.components.lifecycle import Lifecycle, LifecycleState, LifecycleTransition
from btcore_ros2.nav2.conversions import nav2_type
from btcore_ros2.session import RosSession

_SHUTDOWNS: Final = {
    5: LifecycleState.UNCONFIGURED,
    6: LifecycleState.INACTIVE,
    7: LifecycleState.ACTIVE,
}
"""The states in which the three shutdown transitions of `lifecycle_msgs/Transition` are valid."""

CONFIGURE, CLEANUP, ACTIVATE, DEACTIVATE, SHUTDOWN = LifecycleTransition

_COMMANDS: Final = {
    "STARTUP": (CONFIGURE, ACTIVATE),
    "PAUSE": (DEACTIVATE,),
    "RESUME": (ACTIVATE,),
    "RESET": (DEACTIVATE, CLEANUP),
    "SHUTDOWN": (SHUTDOWN,),
    "CONFIGURE": (CONFIGURE,),
    "CLEANUP": (CLEANUP,),
}
"""The transitions of a command of `nav2_msgs/srv/ManageLifecycleNodes`."""


class ServedNode(Lifecycle):
    """The lifecycle of a node, which is active from the start.

    Args:
        set_active: Called with True when the node is activated, and with False when it stops working.
    """

    def __init__(self, set_active: Callable[[bool], None]) -> None:
        super().__init__()
        self._set_active = set_active
        self.configure()
        self.activate()

    def on_activate(self) -> bool:
        """Start to work."""
        self._set_active(True)
        return True

    def on_deactivate(self) -> bool:
        """Stop working."""
        self._set_active(False)
        return True


class LifecycleManager:
    """Nav2's lifecycle manager *name* with the services of its nodes, by their names.

    Each node has the services `get_state` and `change_state`, the manager `manage_nodes` and `is_active`.
    Nodes are started in order, and stopped in reverse order. A command ends at the first node that refuses a
    transition; only a shutdown continues.

    Raises:
        RosError: nav2_msgs is missing.
    """

    def __init__(self, session: RosSession, name: str, nodes: Mapping[str, ServedNode]) -> None:
        self._nodes = nodes
        create = session.node.create_service
        for node, lifecycle in nodes.items():
            create(GetState, f"{node}/get_state", _state_getter(lifecycle))
            create(ChangeState, f"{node}/change_state", _state_changer(lifecycle))
        self._commands = nav2_type("srv", "ManageLifecycleNodes")
        create(self._commands, f"{name}/manage_nodes", self._manage)
        create(Trigger, f"{name}/is_active", self._answer_is_active)

    @property
    def is_shut_down(self) -> bool:
        """Whether all nodes are finalized, which no command reverses."""
        return all(node.state is LifecycleState.FINALIZED for node in self._nodes.values())

    def _manage(self, request: Any, response: Any) -> Any:
        codes = {getattr(self._commands.Request, name): name for name in _COMMANDS}
        name = codes.get(request.command, "")
        response.success = all(self._change_all(transition) for transition in _COMMANDS.get(name, ()))
        response.success &= bool(name)
        return response

    def _change_all(self, transition: LifecycleTransition) -> bool:
        nodes = list(self._nodes.values())
        if transition is SHUTDOWN:
            for node in reversed(nodes):
                node.shutdown()
            return True
        ordered = nodes if transition in (CONFIGURE, ACTIVATE) else reversed(nodes)
        return all(node.change_state(transition) for node in ordered)

    def _answer_is_active(self, request: object, response: Any) -> Any:
        response.success = all(node.state is LifecycleState.ACTIVE for node in self._nodes.values())
        return response


def _state_getter(node: Lifecycle) -> Callable[[Any, Any], Any]:
    def answer(request: object, response: Any) -> Any:
        response.current_state.id = int(node.state)
        response.current_state.label = node.state.name.lower()
        return response

    return answer


def _state_changer(node: Lifecycle) -> Callable[[Any, Any], Any]:
    def answer(request: Any, response: Any) -> Any:
        transition = _transition(node.state, request.transition.id, request.transition.label)
        response.success = transition is not None and node.change_state(transition)
        return response

    return answer


def _transition(state: LifecycleState, number: int, label: str) -> LifecycleTransition | None:
    """Return the transition of a request, whose *label* has priority as in ROS 2; None if it is unknown."""
    if label:
        return LifecycleTransition.__members__.get(label.upper())
    if number in _SHUTDOWNS:
        return SHUTDOWN if _SHUTDOWNS[number] is state else None
    return next((transition for transition in LifecycleTransition if transition == number), None)
