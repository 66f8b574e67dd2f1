"""Nav2's nodes that ask a server for something that is done at once: clearing, cancelling, choosing."""

from typing import Annotated, Any, ClassVar

from btcore import In, Out, StatefulAction, Status, SyncAction
from btcore_robot.navigation.action import ActionServer
from btcore_robot.navigation.nodes.action_node import NS_PER_MS, ServerName, ServerTimeout, count_recovery
from btcore_robot.navigation.nodes.port_access import OPTIONAL, write_outputs
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import Pose2D

ServiceName = Annotated[In[str], "The costmap: a name with 'local' or 'global' in it."]
Plugins = Annotated[In[list[str]], "The layers that are cleared; all of them here."]
Side = Annotated[In[float], "The side (m) of the square."]


class ClearEntireCostmap(SyncAction):
    """Forget every obstacle of a costmap that isn't on the map. Counts as a recovery."""

    service_name: ServiceName = ""
    server_timeout: ServerTimeout = 20
    plugins: Plugins = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Clear."""
        count_recovery(self.blackboard)
        self.servers.costmap(self.service_name).clear()
        return True


class _ClearPart(SyncAction):
    """Forget the obstacles of a part of a costmap. FAILURE where the robot doesn't know where it is."""

    reset_distance: Side = 1.0
    service_name: ServiceName = ""
    server_timeout: ServerTimeout = 20
    plugins: Plugins = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def around(self) -> Pose2D | None:
        """Where the robot is, in the costmap's frame."""
        if self.servers.costmap(self.service_name) is self.servers.local_costmap:
            return self.servers.robot.odometry().pose
        return self.servers.pose()


class ClearCostmapExceptRegion(_ClearPart):
    """Forget the obstacles of a costmap outside a square around the robot."""

    def tick(self) -> bool:
        """Clear."""
        count_recovery(self.blackboard)
        here = self.around()
        if here is None:
            return False
        self.servers.costmap(self.service_name).clear_except(here, self.reset_distance)
        return True


class ClearCostmapAroundRobot(_ClearPart):
    """Forget the obstacles of a costmap within a square around the robot."""

    def tick(self) -> bool:
        """Clear."""
        count_recovery(self.blackboard)
        here = self.around()
        if here is None:
            return False
        self.servers.costmap(self.service_name).clear_around(here, self.reset_distance)
        return True


class ClearCostmapAroundPose(_ClearPart):
    """Forget the obstacles of the global costmap within a square around *pose*."""

    pose: Annotated[In[Pose2D], "The middle of the square, in the frame map."]

    def tick(self) -> bool:
        """Clear."""
        count_recovery(self.blackboard)
        self.servers.global_costmap.clear_around(self.pose, self.reset_distance)
        return True


class _Cancel(SyncAction):
    """Cancel what a server does now. Always SUCCESS."""

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def server(self) -> ActionServer[Any, Any, Any]:
        """Whose work is cancelled."""
        raise NotImplementedError

    def tick(self) -> bool:
        """Cancel."""
        current = self.server().current
        if current is not None:
            current.cancel()
        return True


class CancelControl(_Cancel):
    """Cancel the following of a path."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """The controller."""
        return self.servers.follow_path


class CancelBackUp(_Cancel):
    """Cancel the backing up."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """The back-up server."""
        return self.servers.back_up


class CancelDriveOnHeading(_Cancel):
    """Cancel the driving straight on."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """The drive-on-heading server."""
        return self.servers.drive_on_heading


class CancelSpin(_Cancel):
    """Cancel the turn."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """The spin server."""
        return self.servers.spin


class CancelWait(_Cancel):
    """Cancel the waiting."""

    def server(self) -> ActionServer[Any, Any, Any]:
        """The wait server."""
        return self.servers.wait


class ReinitializeGlobalLocalization(SyncAction):
    """Have the localiser look for the robot everywhere."""

    service_name: Annotated[In[str], "The localiser's service."] = ""
    server_timeout: ServerTimeout = 20

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Ask."""
        self.servers.localiser.reinitialise_global_localisation()
        return True


class CheckStopStatus(StatefulAction):
    """SUCCESS once the robot has stood for *duration_stopped* ms: RUNNING till then; FAILURE if it moves."""

    velocity_threshold: Annotated[In[float], "The speed (m/s, rad/s) under which it stands."] = 0.01
    duration_stopped: Annotated[In[int], "How long (ms) it has to stand."] = 1000

    def __init__(self, servers: Servers) -> None:
        self.robot = servers.robot
        self.since = 0

    def on_start(self) -> Status:
        """Look."""
        self.since = self.now()
        return self.on_running()

    def on_running(self) -> Status:
        """Look again."""
        twist = self.robot.odometry().twist
        if max(abs(twist.v), abs(twist.w)) > self.velocity_threshold:
            return Status.FAILURE
        stood = self.now() - self.since
        return Status.SUCCESS if stood >= self.duration_stopped * NS_PER_MS else Status.RUNNING


class _Selector(SyncAction):
    """Write which plug-in to use: what the topic says, else the default; FAILURE when both are empty."""

    kind: ClassVar[str] = ""

    def __init__(self, servers: Servers) -> None:
        self.topics = servers.topics

    def tick(self) -> bool:
        """Choose."""
        topic, default = str(self.get_input("topic_name")), str(self.get_input(f"default_{self.kind}"))
        chosen = str(self.topics.get(topic) or default)
        if chosen:
            write_outputs(self, **{f"selected_{self.kind}": chosen})
        return bool(chosen)


class PlannerSelector(_Selector):
    """Write which planner to use: what the topic says, else the default; FAILURE when both are empty."""

    kind = "planner"
    topic_name: Annotated[In[str], "The topic that may choose."] = "planner_selector"
    default_planner: Annotated[In[str], "What is used unless the topic chooses."] = ""
    selected_planner: Annotated[Out[str], "What is to be used."] = OPTIONAL


class ControllerSelector(_Selector):
    """Write which controller to use: what the topic says, else the default; FAILURE when both are empty."""

    kind = "controller"
    topic_name: Annotated[In[str], "The topic that may choose."] = "controller_selector"
    default_controller: Annotated[In[str], "What is used unless the topic chooses."] = ""
    selected_controller: Annotated[Out[str], "What is to be used."] = OPTIONAL


class SmootherSelector(_Selector):
    """Write which smoother to use: what the topic says, else the default; FAILURE when both are empty."""

    kind = "smoother"
    topic_name: Annotated[In[str], "The topic that may choose."] = "smoother_selector"
    default_smoother: Annotated[In[str], "What is used unless the topic chooses."] = ""
    selected_smoother: Annotated[Out[str], "What is to be used."] = OPTIONAL


class GoalCheckerSelector(_Selector):
    """Write which goal checker to use: what the topic says, else the default; FAILURE when both are empty."""

    kind = "goal_checker"
    topic_name: Annotated[In[str], "The topic that may choose."] = "goal_checker_selector"
    default_goal_checker: Annotated[In[str], "What is used unless the topic chooses."] = ""
    selected_goal_checker: Annotated[Out[str], "What is to be used."] = OPTIONAL


class ProgressCheckerSelector(_Selector):
    """Write which progress checker to use: what the topic says, else the default; FAILURE without both."""

    kind = "progress_checker"
    topic_name: Annotated[In[str], "The topic that may choose."] = "progress_checker_selector"
    default_progress_checker: Annotated[In[str], "What is used unless the topic chooses."] = ""
    selected_progress_checker: Annotated[Out[str], "What is to be used."] = OPTIONAL


class PathHandlerSelector(_Selector):
    """Write which path handler to use: what the topic says, else the default; FAILURE when both are empty."""

    kind = "path_handler"
    topic_name: Annotated[In[str], "The topic that may choose."] = "path_handler_selector"
    default_path_handler: Annotated[In[str], "What is used unless the topic chooses."] = ""
    selected_path_handler: Annotated[Out[str], "What is to be used."] = OPTIONAL
