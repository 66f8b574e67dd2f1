"""A plug-in for navigation trees by a third party."""

from btcore import In, SyncAction, condition
from btcore_navigation.servers import Servers
from btcore_robot.robot import Robot


@condition
def is_path_short(servers: Servers, length: In[float] = 5.0) -> bool:
    """SUCCESS while the remaining path is shorter than *length* (m)."""
    path = servers.compute_path.latest_path
    return path is not None and servers.remaining(path) < length


class Nod(SyncAction):
    """Look down a little."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def tick(self) -> bool:
        """Look down."""
        self.robot.move_head(0.0, -0.3)
        return True
