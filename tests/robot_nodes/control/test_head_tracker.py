"""Head tracking: PID, colour detection, tracker and lifecycle, by the book's figures (chapter 5.2)."""

import numpy as np
import pytest

from btcore_robot.components.component import Component, ComponentOptions
from btcore_robot.components.lifecycle import Lifecycle, LifecycleState, LifecycleTransition
from btcore_robot.components.parameters import ParameterError
from btcore_robot.control.head_tracker import (
    PID,
    REACTIVE,
    HeadTracker,
    PanTiltCommand,
    command_from_detection,
)
from btcore_robot.perception.colour import (
    WOOD,
    ColourRange,
    Detection,
    Detections,
    ObjectDetector,
    colour_mask,
    debug_image,
    detect_colour,
    detect_each,
)
from btcore_robot.robot import CameraImage, HeadInfo, HeadPosition
from tests.robot_nodes.conftest import ComponentRig, RecordingRobot

WOODEN = (170, 120, 60)  # RGB; OpenCV's HSV (16, 165, 170)
GREY = (120, 120, 120)


def picture(*patches: tuple[int, int, int, int], stamp: int = 0) -> CameraImage:
    """Return a grey picture of 640x480 with rectangles of the colour of wood (left, top, width, height)."""
    rgb = np.full((480, 640, 3), GREY, dtype=np.uint8)
    for left, top, width, height in patches:
        rgb[top : top + height, left : left + width] = WOODEN
    return CameraImage(rgb, stamp, "camera")


# --- PID


def test_pid_a_small_error_with_the_class_defaults() -> None:
    pid = PID(0.0, 1.0, 0.0, 1.0)
    assert pid.output(0.0) == pytest.approx(0.0, abs=0.05)
    assert pid.output(0.1) < 0.099
    assert pid.output(0.1) > -0.4
    assert pid.output(0.1) < 0.3


def test_pid_stays_within_its_limits_and_keeps_the_sign() -> None:
    random = np.random.default_rng(1)
    pid = PID(0.0, 1.0, 0.0, 1.0)
    pid.set_gains(1.0, 0.0, 0.0)
    for error in random.uniform(-5.0, 5.0, 100_000).tolist():
        output = pid.output(error)
        assert -1.0 <= output <= 1.0
        assert output == 0.0 if error == 0.0 else output * error > 0.0
        if abs(error) > 1.0:
            assert abs(output) == 1.0


def test_pid_output_is_zero_below_the_minimum_and_full_above_the_maximum_error() -> None:
    pid = PID(0.1, 1.0, 0.2, 0.8)
    pid.set_gains(1.0, 0.0, 0.0)
    assert pid.output(0.09) == 0.0
    assert pid.output(0.5) == pytest.approx(0.2 + 0.5 * 0.6)
    assert pid.output(-0.5) == pytest.approx(-0.2 - 0.5 * 0.6)
    assert pid.output(3.0) == 0.8


def test_pid_the_integral_decays_by_a_third_and_the_derivative_is_the_change() -> None:
    pid = PID(0.0, 1.0, 0.0, 1.0)
    pid.set_gains(0.0, 1.0, 0.0)
    assert [pid.output(0.3) for _ in range(2)] == pytest.approx([0.2, (0.2 + 0.3) * 2 / 3])
    pid.reset()
    pid.set_gains(0.0, 0.0, 1.0)
    assert [pid.output(0.3), pid.output(0.3), pid.output(0.1)] == pytest.approx([0.3, 0.0, -0.2])


# --- the detector


def test_a_detection_has_a_box_around_all_pixels_and_the_centre_of_mass() -> None:
    found = detect_colour(picture((100, 50, 40, 20), (300, 200, 40, 60)), WOOD)
    assert found is not None
    assert (found.left, found.top, found.width, found.height) == (100, 50, 240, 210)
    assert found.x == pytest.approx((800 * 119.5 + 2400 * 319.5) / 3200)
    assert found.y == pytest.approx((800 * 59.5 + 2400 * 229.5) / 3200)
    assert found.image_size == (640, 480)


def test_without_a_pixel_of_the_colour_nothing_is_found() -> None:
    assert detect_colour(picture(), WOOD) is None


def test_exercise_a_box_for_each_separate_object_the_largest_first() -> None:
    found = detect_each(picture((100, 50, 40, 20), (300, 200, 40, 60), (10, 10, 2, 2)), WOOD)
    assert [(area.left, area.top, area.width, area.height) for area in found] == [
        (300, 200, 40, 60),
        (100, 50, 40, 20),
    ]


def test_the_books_colour_range_of_wood_and_the_default_colour_range() -> None:
    assert ColourRange((15, 20), (50, 200), (20, 200)) == WOOD
    assert ColourRange() == ColourRange((0, 180), (0, 255), (0, 255))
    assert colour_mask(picture(), ColourRange()).all()


def test_the_debug_image_dims_the_background_and_draws_the_detections_box() -> None:
    seen = picture((100, 50, 40, 20))
    shown = debug_image(seen, WOOD)
    assert shown[400, 400].tolist() == [40, 40, 40]
    assert shown[55, 110].tolist() == list(WOODEN)
    assert shown[50, 100].tolist() == shown[69, 139].tolist() == [255, 255, 0]


def detector(robot: RecordingRobot, **parameters) -> tuple[Component, ObjectDetector]:
    """Return a detector, and another component beside it."""
    rig = ComponentRig(robot)
    component = ObjectDetector(rig.context, ComponentOptions(parameters=parameters))
    other = Component("other", rig.context)
    rig.add(component, other)
    return other, component


def test_the_detector_publishes_its_detections_to_subscribers(robot: RecordingRobot) -> None:
    other, component = detector(robot, hsv_ranges=[15, 20, 50, 200, 20, 200])
    images, received = other.create_publisher("input_image", CameraImage), []
    images.publish(picture((100, 50, 40, 20)))
    robot.clock.sleep(0.0)
    assert not component.detections.has_subscribers
    other.create_subscription("detection", Detections, received.append)
    images.publish(picture())
    images.publish(picture((100, 50, 40, 20), (300, 200, 40, 60)))
    robot.clock.sleep(0.0)
    assert [len(message.objects) for message in received] == [1]


def test_the_detector_requires_six_numbers_in_hsv_ranges(robot: RecordingRobot) -> None:
    with pytest.raises(ParameterError, match="hsv_ranges has 6 numbers"):
        detector(robot, hsv_ranges=[1, 2])


# --- the tracker


@pytest.mark.parametrize(
    ("x", "y", "pan", "tilt"), [(320, 240, 0, 0), (640, 240, 1, 0), (0, 480, -1, 1), (480, 120, 0.5, -0.5)]
)
def test_command_is_position_in_picture_from_minus_1_to_1(x: int, y: int, pan: float, tilt: float) -> None:
    detection = Detection(0, 0, 1, 1, x, y, (640, 480), 7)
    assert command_from_detection(detection) == PanTiltCommand(pan, tilt, 7)


@pytest.fixture
def watching(robot: RecordingRobot) -> RecordingRobot:
    """A robot with a head and a camera."""
    robot.head_limits = HeadInfo(-1.3, 1.3, -1.0, 0.7, 3.0)
    robot.head_position = HeadPosition(0.0, 0.0, 0)
    return robot


def active(robot: RecordingRobot, **settings) -> HeadTracker:
    tracker = HeadTracker(robot, **settings)
    assert tracker.configure()
    assert tracker.activate()
    return tracker


@pytest.mark.parametrize(
    ("left", "top", "pan", "tilt"), [(600, 220, -1, 0), (0, 220, 1, 0), (300, 440, 0, -1), (300, 0, 0, 1)]
)
def test_head_turns_to_object(watching: RecordingRobot, left: int, top: int, pan: int, tilt: int) -> None:
    """An object to the right needs a smaller pan angle, and an object below a smaller tilt angle."""
    active(watching)
    watching.newest_image = picture((left, top, 40, 40), stamp=100_000_000)
    watching.clock.sleep(0.1)
    looked = np.array(watching.head_commands[-1])
    assert np.sign(np.where(np.abs(looked) < 0.01, 0.0, looked)).tolist() == [pan, tilt]


def test_the_head_gets_ten_commands_a_second_while_the_tracker_is_active(watching: RecordingRobot) -> None:
    tracker = active(watching)
    watching.clock.sleep(2.0)
    assert len(watching.head_commands) == 20
    tracker.deactivate()
    watching.clock.sleep(2.0)
    assert len(watching.head_commands) == 21


def test_the_head_returns_to_the_middle_after_100_ms_without_a_detection(watching: RecordingRobot) -> None:
    active(watching)
    watching.newest_image = picture((600, 220, 40, 40), stamp=100_000_000)
    watching.clock.sleep(0.2)
    assert watching.head_commands[-1] != (0.0, 0.0)
    watching.clock.sleep(0.1)
    assert watching.head_commands[-1] == (0.0, 0.0)


def test_the_head_returns_to_the_middle_when_the_tracker_is_deactivated(watching: RecordingRobot) -> None:
    tracker = active(watching)
    watching.newest_image = picture((600, 220, 40, 40), stamp=100_000_000)
    watching.clock.sleep(0.1)
    tracker.deactivate()
    assert watching.head_commands[-1] == (0.0, 0.0)


def test_exercise_a_more_reactive_head_reaches_the_object_sooner(watching: RecordingRobot) -> None:
    """The object is to the right by 0.5 rad; the head moves at once, and its picture spans 1.1 rad."""
    needed = {}
    for name, settings in {"book": {}, "reactive": {"tuning": REACTIVE}}.items():
        watching.head_position = HeadPosition(0.0, 0.0, watching.clock.now())
        watching.head_commands.clear()
        tracker = active(watching, **settings)
        start = watching.clock.now()
        while abs(watching.head_position.pan + 0.5) > 0.1:
            off = (-0.5 - watching.head_position.pan) / -0.55
            centre = round((off + 1) * 320)
            watching.newest_image = picture(
                (centre - 10, 230, 20, 20), stamp=watching.clock.now() + 50_000_000
            )
            watching.clock.sleep(0.05)
            if watching.head_commands:
                watching.head_position = HeadPosition(*watching.head_commands[-1], watching.clock.now())
        needed[name] = watching.clock.now() - start
        tracker.shutdown()
    assert needed["reactive"] < 0.7 * needed["book"]


# --- lifecycle


def test_the_states_and_transitions_have_the_numbers_of_ros() -> None:
    assert [
        state.value
        for state in (
            LifecycleState.UNCONFIGURED,
            LifecycleState.INACTIVE,
            LifecycleState.ACTIVE,
            LifecycleState.FINALIZED,
        )
    ] == [1, 2, 3, 4]
    assert [
        LifecycleTransition.CONFIGURE,
        LifecycleTransition.CLEANUP,
        LifecycleTransition.ACTIVATE,
        LifecycleTransition.DEACTIVATE,
    ] == [1, 2, 3, 4]


def test_a_lifecycle_makes_valid_transitions_and_refuses_others() -> None:
    server = Lifecycle()
    assert not server.activate()
    assert not server.deactivate()
    assert server.configure()
    assert server.state is LifecycleState.INACTIVE
    assert not server.configure()
    assert server.activate()
    assert server.state is LifecycleState.ACTIVE
    assert not server.cleanup()
    assert server.deactivate()
    assert server.cleanup()
    assert server.state is LifecycleState.UNCONFIGURED
    assert server.shutdown()
    assert server.state is LifecycleState.FINALIZED
    assert not server.configure()


def test_a_callback_that_fails_refuses_the_transition(robot: RecordingRobot) -> None:
    tracker = HeadTracker(robot)  # a robot without a head
    assert not tracker.configure()
    assert tracker.state is LifecycleState.UNCONFIGURED
