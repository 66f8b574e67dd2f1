"""Nav2's nodes for short server requests: clear a costmap, cancel a goal, select a plug-in."""

from typing import Annotated, Any, ClassVar

from btcore import In, Out, StatefulAction, Status, SyncAction
from btcore_robot.navigation.action import ActionServer
from btcore_robot.navigation.nodes.action_node import NS_PER_MS, ServerName, ServerTimeout, count_recovery
from btcore_robot.navigation.nodes.port_access import OPTIONAL, write_outputs
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import Pose2D

ServiceName = Annotated[In[str], "Service name; the costmap is selected by 'local' or 'global' in it."]
Plugins = Annotated[In[list[str]], "Layers to clear; not used: all layers are cleared."]
Side = Annotated[In[float], "Side length (m) of the square."]


class ClearEntireCostmap(SyncAction):
    """Clear every obstacle of a costmap that is not on the map. Counts as a recovery."""

    service_name: ServiceName = ""
    server_timeout: ServerTimeout = 20
    plugins: Plugins = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Clear the costmap."""
        count_recovery(self.blackboard)
        self.servers.costmap(self.service_name).clear()
        return True


class _ClearPart(SyncAction):
    """Clear part of a costmap. FAILURE while the robot's pose is unknown."""

    reset_distance: Side = 1.0
    service_name: ServiceName = ""
    server_timeout: ServerTimeout = 20
    plugins: Plugins = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def centre(self) -> Pose2D | None:
        """Return the robot's pose in the costmap's frame, or None while it is unknown."""
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


class _Cancel(SyncAction):
    """Cancel the current goal of a server. Always SUCCESS."""

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

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


class ReinitializeGlobalLocalization(SyncAction):
    """Request global localisation: the localiser searches for the robot on the whole map."""

    service_name: Annotated[In[str], "Service name; not used here."] = ""
    server_timeout: ServerTimeout = 20

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Request global localisation."""
        self.servers.localiser.reinitialise_global_localisation()
        return True


class CheckStopStatus(StatefulAction):
    """SUCCESS when the robot has stood for *duration_stopped* ms, RUNNING until then, FAILURE if it moves."""

    velocity_threshold: Annotated[In[float], "Velocity (m/s, rad/s) up to which the robot is stopped."] = 0.01
    duration_stopped: Annotated[In[int], "Time (ms) for which the robot must be stopped."] = 1000

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
    topic_name: Annotated[In[str], "Topic that selects the planner."] = "planner_selector"
    default_planner: Annotated[In[str], "Planner to use when the topic selects none."] = ""
    selected_planner: Annotated[Out[str], "Selected planner."] = OPTIONAL


class ControllerSelector(_Selector):
    """Select the controller: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "controller"
    topic_name: Annotated[In[str], "Topic that selects the controller."] = "controller_selector"
    default_controller: Annotated[In[str], "Controller to use when the topic selects none."] = ""
    selected_controller: Annotated[Out[str], "Selected controller."] = OPTIONAL


class SmootherSelector(_Selector):
    """Select the smoother: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "smoother"
    topic_name: Annotated[In[str], "Topic that selects the smoother."] = "smoother_selector"
    default_smoother: Annotated[In[str], "Smoother to use when the topic selects none."] = ""
    selected_smoother: Annotated[Out[str], "Selected smoother."] = OPTIONAL


class GoalCheckerSelector(_Selector):
    """Select the goal checker: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "goal_checker"
    topic_name: Annotated[In[str], "Topic that selects the goal checker."] = "goal_checker_selector"
    default_goal_checker: Annotated[In[str], "Goal checker to use when the topic selects none."] = ""
    selected_goal_checker: Annotated[Out[str], "Selected goal checker."] = OPTIONAL


class ProgressCheckerSelector(_Selector):
    """Select the progress checker: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "progress_checker"
    topic_name: Annotated[In[str], "Topic that selects the progress checker."] = "progress_checker_selector"
    default_progress_checker: Annotated[In[str], "Progress checker to use when the topic selects none."] = ""
    selected_progress_checker: Annotated[Out[str], "Selected progress checker."] = OPTIONAL


class PathHandlerSelector(_Selector):
    """Select the path handler: the topic's last message, or the default. FAILURE when both are empty."""

    kind = "path_handler"
    topic_name: Annotated[In[str], "Topic that selects the path handler."] = "path_handler_selector"
    default_path_handler: Annotated[In[str], "Path handler to use when the topic selects none."] = ""
    selected_path_handler: Annotated[Out[str], "Selected path handler."] = OPTIONAL
