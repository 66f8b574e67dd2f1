"""The programs that can be started by name, for example by a launch file."""

from collections.abc import Callable
from importlib import import_module

from btcore.suggestions import did_you_mean
from btcore_robot.components.component import Component, ComponentContext, ComponentOptions
from btcore_robot.errors import RobotError

_FIRST_STEPS = "btcore_robot.components.first_steps"
_FSM = "btcore_robot.control.bumpgo_fsm"
_VFF = "btcore_robot.control.vff"
_DETECTOR = "btcore_robot.perception.obstacle_detector"

# Class names as strings: a module is imported when one of its programs starts.
PROGRAMS: dict[str, tuple[tuple[str, str], ...]] = {
    "logger": ((_FIRST_STEPS, "Logger"),),
    "publisher": ((_FIRST_STEPS, "NumberPublisher"),),
    "subscriber": ((_FIRST_STEPS, "NumberSubscriber"),),
    "executor": ((_FIRST_STEPS, "NumberPublisher"), (_FIRST_STEPS, "NumberSubscriber")),
    "localization": ((_FIRST_STEPS, "Localization"),),
    "bumpgo": ((_FSM, "BumpGo"),),
    "bumpgo_diagonals": ((_FSM, "Diagonals"),),
    "bumpgo_open_loop": ((_FSM, "OpenLoop"),),
    "bumpgo_closed_loop": ((_FSM, "ClosedLoop"),),
    "avoidance_vff": ((_VFF, "Avoidance"),),
    "avoidance_vff_all": ((_VFF, "AvoidanceFromAll"),),
    "obstacle_detector": ((_DETECTOR, "ObstacleDetector"),),
    "obstacle_detector_improved": ((_DETECTOR, "ObstacleDetectorImproved"),),
    "obstacle_monitor": ((_DETECTOR, "ObstacleMonitor"),),
    "obstacle_in_frames": ((_DETECTOR, "ObstacleInFrames"),),
    "object_detector": (("btcore_robot.perception.colour", "ObjectDetector"),),
    "displacement": ((_DETECTOR, "Displacement"),),
    "bridge": (("btcore_robot.components.robot_bridge", "RobotBridge"),),
}
"""The components of every program, each as the names of its module and its class."""

ComponentFactory = Callable[[ComponentContext, ComponentOptions], Component]
"""A function that creates the component of a program."""


class UnknownProgramError(RobotError):
    """There is no program of that name. The message lists the programs or suggests a name."""


def create_components(
    program: str, context: ComponentContext, options: ComponentOptions | None = None
) -> list[Component]:
    """Create the components of a program. Add all of them to the same executor.

    Args:
        program: The name of the program.
        context: The resources that the components share.
        options: The options of each component; the name is ignored for a program of several components.

    Returns:
        The components.

    Raises:
        UnknownProgramError: There is no program of that name.
    """
    if program not in PROGRAMS:
        hint = did_you_mean(program, PROGRAMS) or f": there are {', '.join(PROGRAMS)}"
        raise UnknownProgramError(f"there is no program '{program}'{hint}")
    options = options if options is not None else ComponentOptions()
    parts = PROGRAMS[program]
    if len(parts) > 1:
        options = ComponentOptions(None, options.remap, options.parameters)
    factories: list[ComponentFactory] = [getattr(import_module(module), name) for module, name in parts]
    return [factory(context, options) for factory in factories]
