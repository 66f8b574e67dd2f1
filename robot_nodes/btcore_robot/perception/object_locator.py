"""Where the coloured objects are that the camera sees, as a lifecycle component."""

from collections.abc import Callable, Sequence

from btcore_robot.perception.boxes import Box, boxes
from btcore_robot.perception.colour import WOOD, ColourRange
from btcore_robot.process.lifecycle import LifecycleComponent
from btcore_robot.robot import Phase, Robot
from btcore_robot.transforms import TransformError, TransformTree
from btcore_scene import BoundingBox, MovingScene, StaticScene

RATE = 2.0
"""How often (Hz) it looks."""


class ObjectLocator(LifecycleComponent):
    """While active, looks for *colours* in the robot's pictures and tells the boxes in *frame*.

    It asks for pictures only while it is active, and leaves out one of which *transforms* doesn't know where
    the camera was. A robot without a camera refuses `configure`.
    """

    def __init__(
        self, robot: Robot, transforms: TransformTree, frame: str = "map", colours: ColourRange = WOOD
    ) -> None:
        super().__init__()
        self.robot = robot
        self.transforms = transforms
        self.frame = frame
        self.colours = colours
        self.boxes: Sequence[Box] = ()
        """What the newest picture showed, the largest first."""
        self._end: Callable[[], None] | None = None
        self._looked = -1

    def on_configure(self) -> bool:
        """See whether there is a camera."""
        return self.robot.camera_info is not None

    def on_activate(self) -> bool:
        """Begin to look."""
        self._end = self.robot.schedule.every(RATE, Phase.HEAD, self.step)
        return True

    def on_deactivate(self) -> bool:
        """Stop looking, and forget what was seen."""
        if self._end is not None:
            self._end()
            self._end = None
            self.boxes = ()
        return True

    def step(self, now: int) -> None:
        """Look at a picture, if there is a new one."""
        picture, lens = self.robot.camera(), self.robot.camera_info
        if picture is None or lens is None or picture.stamp == self._looked:
            return
        try:
            camera = self.transforms.lookup(self.frame, picture.frame, picture.stamp)
        except TransformError:
            return
        self._looked = picture.stamp
        self.boxes = tuple(boxes(picture, lens, self.colours, self.frame, camera))

    def scene_static(self) -> StaticScene:
        """Return an empty scene: everything moves."""
        return StaticScene()

    def scene_moving(self) -> MovingScene:
        """Return the boxes found in the newest picture."""
        return MovingScene(
            boxes=[
                BoundingBox(name="object", frame=box.frame, position=box.centre, size=box.size)
                for box in self.boxes
            ]
        )
