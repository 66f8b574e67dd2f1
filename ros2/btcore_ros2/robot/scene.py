"""The scene messages of a robot over ROS 2, for the monitor."""

from collections.abc import Sequence

from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import BASE_FRAME, MAP_FRAME, ODOM_FRAME, CameraImage, CameraInfo, Robot
from btcore_robot.scene_messages import camera_message, laser_message, picture_message, scan_message
from btcore_scene import UPRIGHT, Cylinder, Frame, MovingScene, Part, StaticScene

BODY_HEIGHT = 0.3
"""The height (m) of the cylinder that stands for a robot without shapes."""
BODY_COLOR = (140, 145, 153, 255)


class RobotScene:
    """The scene messages of *robot*: its shapes, frames, scans and pictures.

    The pose of the odometry in the map comes from the navigation; without it both frames are the same.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._last_picture: CameraImage | None = None
        self._is_placed = False

    def static(self, shapes: Sequence[Part], lens: CameraInfo | None) -> StaticScene:
        """Return the parts of the scene that do not change; `moving` then returns everything again.

        Args:
            shapes: The shapes of the robot's links. Without any, a cylinder stands for the robot.
            lens: The camera, if it is known.
        """
        self._last_picture, self._is_placed = None, False
        robot, battery = self._robot, self._robot.battery()
        body = Cylinder(
            frame=BASE_FRAME,
            radius=robot.base_info.radius,
            length=BODY_HEIGHT,
            position=(0.0, 0.0, BODY_HEIGHT / 2),
            color=BODY_COLOR,
        )
        return StaticScene(
            frame=MAP_FRAME,
            parts=shapes or [body],
            laser=laser_message(robot.laser_info),
            footprint_radius=robot.base_info.radius,
            battery=None if battery is None else battery.level,
            cameras=() if lens is None else [camera_message(lens)],
        )

    def moving(self, links: Sequence[Frame], picture: CameraImage | None) -> MovingScene:
        """Return the present frames, and the newest scan, velocity, battery level and picture.

        Args:
            links: The frames of the robot below `base_footprint`.
            picture: The newest picture; it is sent once.
        """
        robot = self._robot
        odometry, scan, battery = robot.odometry(), robot.scan(), robot.battery()
        is_new = picture is not None and picture is not self._last_picture
        self._last_picture = picture
        place = Transform.from_pose(odometry.pose)
        frames = [Frame(BASE_FRAME, ODOM_FRAME, place.position, place.quaternion), *links]
        if not self._is_placed:
            self._is_placed = True
            frames.append(Frame(ODOM_FRAME, MAP_FRAME, (0.0, 0.0, 0.0), UPRIGHT))
        return MovingScene(
            stamp=robot.clock.now(),
            frames=frames,
            velocity=(odometry.twist.v, odometry.twist.w),
            battery=None if battery is None else battery.level,
            scan=None if scan is None else scan_message(scan),
            pictures=[picture_message(picture)] if picture is not None and is_new else (),
        )
