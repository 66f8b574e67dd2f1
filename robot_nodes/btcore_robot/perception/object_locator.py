"""Location of coloured objects that the camera sees, as a lifecycle component."""

from collections.abc import Callable, Sequence

from btcore_robot.perception.boxes import BoundingBox3D, detect_boxes
from btcore_robot.perception.colour import WOOD, ColourRange
from btcore_robot.process.lifecycle import LifecycleComponent
from btcore_robot.robot import Phase, Robot
from btcore_robot.transforms import TransformError, TransformTree
from btcore_scene import BoundingBox, MovingScene, StaticScene

RATE = 2.0
"""The rate (Hz) at which images are processed."""


class ObjectLocator(LifecycleComponent):
    """While active, detect objects within *colours* in the robot's camera images and locate them in *frame*.

    Images are requested while the locator is active only. An image is ignored if *transforms* does not know
    the camera's pose at its stamp. `configure` returns False for a robot without a camera.
    """

    def __init__(
        self, robot: Robot, transforms: TransformTree, frame: str = "map", colours: ColourRange = WOOD
    ) -> None:
        super().__init__()
        self.robot = robot
        self.transforms = transforms
        self.frame = frame
        self.colours = colours
        self.boxes: Sequence[BoundingBox3D] = ()
        """The boxes of the objects in the newest image, the largest first."""
        self._stop_steps: Callable[[], None] | None = None
        self._last_stamp = -1

    def on_configure(self) -> bool:
        """Return whether the robot has a camera."""
        return self.robot.camera_info is not None

    def on_activate(self) -> bool:
        """Start the periodic steps."""
        self._stop_steps = self.robot.schedule.every(RATE, Phase.HEAD, self.step)
        return True

    def on_deactivate(self) -> bool:
        """Stop the periodic steps and clear the results."""
        if self._stop_steps is not None:
            self._stop_steps()
            self._stop_steps = None
            self.boxes = ()
        return True

    def step(self, now: int) -> None:
        """Process the camera image if it is new. *now* is the time (ns)."""
        image, camera_info = self.robot.camera(), self.robot.camera_info
        if image is None or camera_info is None or image.stamp == self._last_stamp:
            return
        try:
            camera = self.transforms.lookup(self.frame, image.frame, image.stamp)
        except TransformError:
            return
        self._last_stamp = image.stamp
        self.boxes = tuple(detect_boxes(image, camera_info, self.colours, self.frame, camera))

    def scene_static(self) -> StaticScene:
        """Return an empty scene: everything moves."""
        return StaticScene()

    def scene_moving(self) -> MovingScene:
        """Return the boxes of the objects in the newest image."""
        return MovingScene(
            boxes=[
                BoundingBox(name="object", frame=box.frame, position=box.centre, size=box.size)
                for box in self.boxes
            ]
        )
