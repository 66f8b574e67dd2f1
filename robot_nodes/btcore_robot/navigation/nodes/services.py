"""Nav2's nodes for short server requests: clear a costmap, cancel a goal, select a plug-in."""

from typing import Annotated, Any, ClassVar

from btcore import Direction, In, Port, StatefulAction, Status, SyncAction
from btcore.values import STRING
from btcore_robot.navigation.action import ActionServer
from btcore_robot.navigation.nodes.action_node import (
    NS_PER_MS,
    ServerName,
    ServersAction,
    ServerTimeout,
    count_recovery,
)
from btcore_robot.navigation.nodes.port_access import OPTIONAL, write_outputs
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import Pose2D

ServiceName = Annotated[In[str], "Service name; the costmap is selected by 'local' or 'global' in it."]
Plugins = Annotated[In[list[str]], "Layers to clear; not used: all layers are cleared."]
Side = Annotated[In[float], "Side length (m) of the square."]


class ClearEntireCostmap(ServersAction):
    """Clear every obstacle of a costmap that is not on the map. Counts as a recovery."""

    service_name: ServiceName = ""
    server_timeout: ServerTimeout = 20
    plugins: Plugins = OPTIONAL

    def tick(self) -> bool:
        """Clear the costmap."""
        count_recovery(self.blackboard)
        self.servers.costmap(self.service_name).clear()
        return True


class _ClearPart(ServersAction):
    """Clear part of a costmap. FAILURE while the robot's pose is unknown."""

    reset_distance: Side = 1.0
    service_name: ServiceName = ""
    server_timeout: ServerTimeout = 20
    plugins: Plugins = OPTIONAL

    def centre(self) -> Pose2D | None:
        """Return the robot's pose in the costmap's frame, or None while the pose is unknown."""
        if self.servers.costmap(self.service_name) is self.servers.local_costmap:
            # The local costmap is in the odometry frame; the global costmap is in the frame map.
            return self.servers.robot.odometry().pose
        return self.servers.pose()


class ClearCostmapExceptRegion(_ClearPart):
    """Clear the obstacles of a costmap outside a square around the robot."""

    def tick(self) -> bool:
        """Clear the costmap."""
        count_recovery(self.blackboard)
        here = self.centre()
        if here is None:
            return False
        self.servers.costmap(self.service_name).clear_except(here, self.reset_distance)
        return True


class ClearCostmapAroundRobot(_ClearPart):
    """Clear the obstacles of a costmap inside a square around the robot."""

    def tick(self) -> bool:
        """Clear the costmap."""
        count_recovery(self.blackboard)
        here = self.centre()
        if here is None:
            return False
        self.servers.costmap(self.service_name).clear_around(here, self.reset_distance)
        return True


class ClearCostmapAroundPose(_ClearPart):
    """Clear the obstacles of the global costmap inside a square around *pose*."""

    pose: Annotated[In[Pose2D], "Centre of the square, in the frame map."]

    def tick(self) -> bool:
        """Clear the costmap."""
        count_recovery(self.blackboard)
        self.servers.global_costmap.clear_around(self.pose, self.reset_distance)
        return True


class _Cancel(ServersAction):
    """Cancel the current goal of a server. Always SUCCESS."""

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the server whose goal is cancelled."""
        raise NotImplementedError

    def tick(self) -> bool:
        """Cancel the server's current goal, if any."""
        current = self.server().current
        if current is not None:
            current.cancel()
        return True


class CancelControl(_Cancel):
    """Cancel the controller's path following."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the controller server."""
        return self.servers.follow_path


class CancelBackUp(_Cancel):
    """Cancel backing up."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the back-up server."""
        return self.servers.back_up


class CancelDriveOnHeading(_Cancel):
    """Cancel driving on a heading."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the drive-on-heading server."""
        return self.servers.drive_on_heading


class CancelSpin(_Cancel):
    """Cancel the spin behaviour."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the spin server."""
        return self.servers.spin


class CancelWait(_Cancel):
    """Cancel the wait behaviour."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the wait server."""
        return self.servers.wait


class ReinitializeGlobalLocalization(ServersAction):
    """Request global localisation: the localiser searches for the robot on the whole map."""

    service_name: Annotated[In[str], "Service name; not used here."] = ""
    server_timeout: ServerTimeout = 20

    def tick(self) -> bool:
        """Request global localisation."""
        self.servers.localiser.reinitialise_global_localisation()
        return True


class CheckStopStatus(StatefulAction):
    """SUCCESS when the robot has stood for *duration_stopped* ms, RUNNING until then, FAILURE if it moves."""

    velocity_threshold: Annotated[In[float], "Velocity (m/s, rad/s) up to which the robot is stopped."] = 0.01
    duration_stopped: Annotated[In[int], "Time (ms) for which the robot must be stopped."] = 1000

    state_fields = ("since",)

    def __init__(self, servers: Servers) -> None:
        self.robot = servers.robot
        self.since = 0

    def on_start(self) -> Status:
        """Start the time and check the velocity."""
        self.since = self.now()
        return self.on_running()

    def on_running(self) -> Status:
        """Check the velocity and the time."""
        twist = self.robot.odometry().twist
        if max(abs(twist.v), abs(twist.w)) > self.velocity_threshold:
            return Status.FAILURE
        stood = self.now() - self.since
        return Status.SUCCESS if stood >= self.duration_stopped * NS_PER_MS else Status.RUNNING


class _Selector(SyncAction):
    """Write the plug-in to use: the topic's last message, or the default. FAILURE when both are empty."""

    kind: ClassVar[str] = ""
    """The kind of plug-in, which is part of the ports' names."""

    @classmethod
    def provided_ports(cls) -> list[Port]:
        """Return the ports of the topic, the default and the result."""
        words = cls.kind.replace("_", " ")
        default, use = f"default_{cls.kind}", f"{words.capitalize()} to use when the topic selects none."
        return [
            Port(
                "topic_name",
                type=STRING,
                default=f"{cls.kind}_selector",
                description=f"Topic that selects the {words}.",
            ),
            Port(default, type=STRING, default="", description=use),
            Port(f"selected_{cls.kind}", Direction.OUT, STRING, "", f"Selected {words}."),
        ]

    state_fields = ()

    def __init__(self, servers: Servers) -> None:
        self.topics = servers.topics

    def tick(self) -> bool:
        """Write the selected plug-in."""
        topic, default = str(self.get_input("topic_name")), str(self.get_input(f"default_{self.kind}"))
        selected = str(self.topics.get(topic) or default)
        if selected:
            write_outputs(self, **{f"selected_{self.kind}": selected})
        return bool(selected)


class PlannerSelector(_Selector):
    """Select the planner: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "planner"


class ControllerSelector(_Selector):
    """Select the controller: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "controller"


class SmootherSelector(_Selector):
    """Select the smoother: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "smoother"


class GoalCheckerSelector(_Selector):
    """Select the goal checker: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "goal_checker"


class ProgressCheckerSelector(_Selector):
    """Select the progress checker: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "progress_checker"


class PathHandlerSelector(_Selector):
    """Select the path handler: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "path_handler"
