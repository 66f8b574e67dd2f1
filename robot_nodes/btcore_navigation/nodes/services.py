"""Nav2's nodes for short server requests: clear a costmap, cancel a goal, select a plug-in."""

from typing import Annotated, ClassVar

from btcore import (
    FAILURE,
    RUNNING,
    SUCCESS,
    Direction,
    In,
    NodeSpec,
    Port,
    StatefulAction,
    Status,
    SyncAction,
)
from btcore.clock import NS_PER_MS
from btcore.engine.node import read_clock
from btcore.values import STRING
from btcore_navigation.navigation_servers import (
    AnyGoalHandle,
    ClearCostmap,
    ClearedArea,
    NavigationServers,
    ReinitializeLocalization,
)
from btcore_navigation.nodes.action_node import BtServiceNode, ServerName, ServiceName, count_recovery
from btcore_navigation.nodes.port_access import OPTIONAL, optional_input, write_outputs
from btcore_robot.robot import Pose2D

Plugins = Annotated[In[list[str]], "Layers to clear; navigation in this process clears all layers."]
Side = Annotated[In[float], "Side length (m) of the square."]


class _Clear(BtServiceNode):
    """Base of the nodes that clear a costmap. Each start counts as a recovery."""

    area: ClassVar[ClearedArea]
    spec = NodeSpec(writes=("number_recoveries",))

    service_name: ServiceName = ""
    plugins: Plugins = OPTIONAL

    def send(self) -> AnyGoalHandle:
        """Count the recovery and send the request."""
        count_recovery(self._blackboard)
        plugins = optional_input(self, "plugins")
        request = self.request(tuple(plugins) if isinstance(plugins, list) else ())
        return self.servers.request(request, self.service_name)

    def request(self, plugins: tuple[str, ...]) -> ClearCostmap:
        """Return the request to clear the layers *plugins*."""
        return ClearCostmap(self.area, plugins=plugins)


class ClearEntireCostmap(_Clear):
    """Clears every obstacle of a costmap that is not on the map. Counts as a recovery."""

    area = ClearedArea.ENTIRE


class _ClearPart(_Clear):
    """Base of the nodes that clear part of a costmap. FAILURE while the robot's pose is unknown."""

    reset_distance: Side = 1.0

    def request(self, plugins: tuple[str, ...]) -> ClearCostmap:
        """Return the request with the side length of the square."""
        return ClearCostmap(self.area, self.reset_distance, plugins=plugins)


class ClearCostmapExceptRegion(_ClearPart):
    """Clears the obstacles of a costmap outside a square around the robot."""

    area = ClearedArea.EXCEPT_REGION


class ClearCostmapAroundRobot(_ClearPart):
    """Clears the obstacles of a costmap inside a square around the robot."""

    area = ClearedArea.AROUND_ROBOT


class ClearCostmapAroundPose(_ClearPart):
    """Clears the obstacles of the global costmap inside a square around *pose*."""

    area = ClearedArea.AROUND_POSE

    pose: Annotated[In[Pose2D], "Centre of the square, in the frame map."]

    def request(self, plugins: tuple[str, ...]) -> ClearCostmap:
        """Return the request with the centre of the square."""
        return ClearCostmap(self.area, self.reset_distance, self.pose, plugins)


class _Cancel(BtServiceNode):
    """Cancels the goals of a server. SUCCESS also if there are none."""

    action: ClassVar[str] = ""
    """Nav2's default name of the action."""

    server_name: ServerName = ""

    def send(self) -> AnyGoalHandle:
        """Send the request."""
        return self.servers.cancel_goals(self.action, self.server_name)


class CancelControl(_Cancel):
    """Cancels the controller's path following."""

    action = "follow_path"


class CancelBackUp(_Cancel):
    """Cancels backing up."""

    action = "backup"


class CancelDriveOnHeading(_Cancel):
    """Cancels driving on a heading."""

    action = "drive_on_heading"


class CancelSpin(_Cancel):
    """Cancels the spin behaviour."""

    action = "spin"


class CancelWait(_Cancel):
    """Cancels the wait behaviour."""

    action = "wait"


class ReinitializeGlobalLocalization(BtServiceNode):
    """Requests global localisation: the localiser searches for the robot on the whole map."""

    service_name: ServiceName = ""

    def send(self) -> AnyGoalHandle:
        """Send the request."""
        return self.servers.request(ReinitializeLocalization(), self.service_name)


class CheckStopStatus(StatefulAction):
    """SUCCESS when the robot has stood for *duration_stopped* ms, RUNNING until then, FAILURE if it moves."""

    velocity_threshold: Annotated[In[float], "Velocity (m/s, rad/s) up to which the robot is stopped."] = 0.01
    duration_stopped: Annotated[In[int], "Time (ms) for which the robot must be stopped."] = 1000

    spec = NodeSpec(state_fields=("since",))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.since = 0

    def on_start(self) -> Status:
        """Start the time and check the velocity."""
        self.since = read_clock(self)
        return self.on_running()

    def on_running(self) -> Status:
        """Check the velocity and the time."""
        odometry = self.servers.odometry()
        if odometry is None:
            self.since = read_clock(self)
            return RUNNING
        twist = odometry.twist
        if max(abs(twist.v), abs(twist.w)) > self.velocity_threshold:
            return FAILURE
        end = self.since + self.duration_stopped * NS_PER_MS
        return SUCCESS if self.has_passed(end) else RUNNING


class _Selector(SyncAction):
    """Writes the plug-in to use: the topic's last message, or the default. FAILURE when both are empty."""

    plugin: ClassVar[str] = ""
    """The name of the plug-in, which is part of the ports' names."""

    @classmethod
    def provided_ports(cls) -> list[Port]:
        """Return the ports of the topic, the default and the result."""
        words = cls.plugin.replace("_", " ")
        default, use = f"default_{cls.plugin}", f"{words.capitalize()} to use when the topic selects none."
        return [
            Port(
                "topic_name",
                type=STRING,
                default=f"{cls.plugin}_selector",
                description=f"Topic that selects the {words}.",
            ),
            Port(default, type=STRING, default="", description=use),
            Port(f"selected_{cls.plugin}", Direction.OUT, STRING, "", f"Selected {words}."),
        ]

    spec = NodeSpec(state_fields=())

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        topic = optional_input(self, "topic_name")
        if isinstance(topic, str):
            # Subscribes, so that a latched message arrives before the first tick.
            servers.latest(topic, str)

    def tick(self) -> bool:
        """Write the selected plug-in."""
        topic, default = str(self.get_input("topic_name")), str(self.get_input(f"default_{self.plugin}"))
        selected = str(self.servers.latest(topic, str) or default)
        if selected:
            write_outputs(self, **{f"selected_{self.plugin}": selected})
        return bool(selected)


class PlannerSelector(_Selector):
    """Selects the planner: the topic's last message, or the default. FAILURE when both are empty."""

    plugin = "planner"


class ControllerSelector(_Selector):
    """Selects the controller: the topic's last message, or the default. FAILURE when both are empty."""

    plugin = "controller"


class SmootherSelector(_Selector):
    """Selects the smoother: the topic's last message, or the default. FAILURE when both are empty."""

    plugin = "smoother"


class GoalCheckerSelector(_Selector):
    """Selects the goal checker: the topic's last message, or the default. FAILURE when both are empty."""

    plugin = "goal_checker"


class ProgressCheckerSelector(_Selector):
    """Selects the progress checker: the topic's last message, or the default. FAILURE when both are empty."""

    plugin = "progress_checker"


class PathHandlerSelector(_Selector):
    """Selects the path handler: the topic's last message, or the default. FAILURE when both are empty."""

    plugin = "path_handler"
