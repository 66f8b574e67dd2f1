"""Poses in a tree's XML, in the book's format and in Nav2's."""

import math

import pytest

from btcore import ConversionError
from btcore_robot.leaves.pose_types import PoseList, pose_from_text, pose_to_text
from btcore_robot.robot import Pose2D

HALF = math.sqrt(0.5)
"""The z and the w of the quaternion of a quarter turn."""


@pytest.mark.parametrize(
    ("text", "pose"),
    [
        ("1.5;-2", Pose2D(1.5, -2.0, 0.0)),
        (" 1.5 ; -2 ; 0.5 ", Pose2D(1.5, -2.0, 0.5)),
        ("0;0;7", Pose2D(0.0, 0.0, 7.0 - math.tau)),
        (f"1;2;0;0;0;{HALF};{HALF}", Pose2D(1.0, 2.0, math.pi / 2)),
        (f"0;map;1;2;0;0;0;{HALF};{HALF}", Pose2D(1.0, 2.0, math.pi / 2)),
        ("0;/map;1;2;0;0;0;0;1", Pose2D(1.0, 2.0, 0.0)),
        ("0;;1;2;0;0;0;0;1", Pose2D(1.0, 2.0, 0.0)),
    ],
)
def test_a_pose_in_the_books_form_and_in_nav2s(text: str, pose: Pose2D) -> None:
    read = pose_from_text(text)
    assert (read.x, read.y, read.yaw) == pytest.approx((pose.x, pose.y, pose.yaw))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "the form is x;y or x;y;yaw"),
        ("kitchen", "the form is x;y or x;y;yaw"),
        ("1,2", "the form is x;y or x;y;yaw"),
        ("1;2;3;4", "but there are 4 parts"),
        ("nan;1", "its numbers must be finite"),
        ("1;inf", "its numbers must be finite"),
        ("0;odom;1;2;0;0;0;0;1", "in the frame 'odom', but poses must be in map"),
    ],
)
def test_an_invalid_pose_raises(text: str, why: str) -> None:
    with pytest.raises(ConversionError) as fault:
        pose_from_text(text)
    assert why in str(fault.value)


def test_a_written_pose_is_read_unchanged() -> None:
    assert pose_from_text(pose_to_text(Pose2D(1.25, -0.5, 3.0))) == Pose2D(1.25, -0.5, 3.0)


@pytest.mark.parametrize(
    ("text", "poses"),
    [
        ("", []),
        ("1;2", [Pose2D(1.0, 2.0, 0.0)]),
        ("1;2|3;4;0.5", [Pose2D(1.0, 2.0, 0.0), Pose2D(3.0, 4.0, 0.5)]),
        ("0;map;1;2;0;0;0;0;1;0;map;3;4;0;0;0;0;1", [Pose2D(1.0, 2.0, 0.0), Pose2D(3.0, 4.0, 0.0)]),
    ],
)
def test_several_poses_are_separated_by_bars_or_written_in_nav2s_form(text: str, poses: list[Pose2D]) -> None:
    kind = PoseList()
    assert kind.from_text(text) == poses
    assert kind.from_text(kind.to_text(poses)) == poses


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1;2|", "'' is not a pose"),
        ("1;2;3;4;5;6;7;8;9;10", "separate poses with |"),
        ("a;b", "'a;b' is not a pose"),
    ],
)
def test_an_invalid_list_of_poses_raises(text: str, why: str) -> None:
    with pytest.raises(ConversionError) as fault:
        PoseList().from_text(text)
    assert why in str(fault.value)
