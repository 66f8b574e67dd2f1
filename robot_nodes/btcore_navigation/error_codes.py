"""The error codes with which Nav2's servers report why a goal failed, for trees written for Nav2."""

from enum import IntEnum
from typing import Final


class Nav2ErrorCode(IntEnum):
    """Nav2's error codes (`nav2_msgs/action/*.action` of its branch main).

    A name that several actions share (UNKNOWN, TF_ERROR, TIMEOUT, COLLISION_AHEAD …) has the action's name as
    prefix. ComputePathThroughPoses repeats the names of ComputePathToPose; its prefix is `THROUGH_`.
    """

    NONE = 0
    GOAL_REJECTED = 1
    SEND_GOAL_FAILURE = 2

    FOLLOW_PATH_UNKNOWN = 100
    INVALID_CONTROLLER = 101
    FOLLOW_PATH_TF_ERROR = 102
    INVALID_PATH = 103
    PATIENCE_EXCEEDED = 104
    FAILED_TO_MAKE_PROGRESS = 105
    NO_VALID_CONTROL = 106
    CONTROLLER_TIMED_OUT = 107
    FOLLOW_PATH_TIMEOUT = 108

    COMPUTE_PATH_UNKNOWN = 200
    INVALID_PLANNER = 201
    COMPUTE_PATH_TF_ERROR = 202
    START_OUTSIDE_MAP = 203
    GOAL_OUTSIDE_MAP = 204
    START_OCCUPIED = 205
    GOAL_OCCUPIED = 206
    COMPUTE_PATH_TIMEOUT = 207
    NO_VALID_PATH = 208

    THROUGH_UNKNOWN = 300
    THROUGH_INVALID_PLANNER = 301
    THROUGH_TF_ERROR = 302
    THROUGH_START_OUTSIDE_MAP = 303
    THROUGH_GOAL_OUTSIDE_MAP = 304
    THROUGH_START_OCCUPIED = 305
    THROUGH_GOAL_OCCUPIED = 306
    THROUGH_TIMEOUT = 307
    THROUGH_NO_VALID_PATH = 308
    NO_VIAPOINTS_GIVEN = 309

    SMOOTH_UNKNOWN = 500
    INVALID_SMOOTHER = 501
    SMOOTH_TIMEOUT = 502
    SMOOTHED_PATH_IN_COLLISION = 503
    FAILED_TO_SMOOTH_PATH = 504
    SMOOTH_INVALID_PATH = 505

    FOLLOW_WAYPOINTS_UNKNOWN = 600
    TASK_EXECUTOR_FAILED = 601
    NO_VALID_WAYPOINTS = 602
    STOP_ON_MISSED_WAYPOINT = 603

    SPIN_UNKNOWN = 700
    SPIN_TIMEOUT = 701
    SPIN_TF_ERROR = 702
    SPIN_COLLISION_AHEAD = 703

    BACKUP_UNKNOWN = 710
    BACKUP_TIMEOUT = 711
    BACKUP_TF_ERROR = 712
    BACKUP_INVALID_INPUT = 713
    BACKUP_COLLISION_AHEAD = 714

    DRIVE_ON_HEADING_UNKNOWN = 720
    DRIVE_ON_HEADING_TIMEOUT = 721
    DRIVE_ON_HEADING_TF_ERROR = 722
    DRIVE_ON_HEADING_COLLISION_AHEAD = 723
    DRIVE_ON_HEADING_INVALID_INPUT = 724

    ASSISTED_TELEOP_UNKNOWN = 730
    ASSISTED_TELEOP_TIMEOUT = 731
    ASSISTED_TELEOP_TF_ERROR = 732

    WAIT_UNKNOWN = 740
    WAIT_TIMEOUT = 741

    NAVIGATE_UNKNOWN = 9000
    FAILED_TO_LOAD_BEHAVIOR_TREE = 9001
    NAVIGATE_TF_ERROR = 9002
    NAVIGATE_TIMEOUT = 9003


CONTROLLER_RECOVERY_HELPS: Final = frozenset(
    {
        Nav2ErrorCode.FOLLOW_PATH_UNKNOWN,
        Nav2ErrorCode.PATIENCE_EXCEEDED,
        Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS,
        Nav2ErrorCode.NO_VALID_CONTROL,
    }
)
"""Errors that clearing the local costmap may resolve: the defaults of WouldAControllerRecoveryHelp."""

PLANNER_RECOVERY_HELPS: Final = frozenset(
    {
        Nav2ErrorCode.COMPUTE_PATH_UNKNOWN,
        Nav2ErrorCode.COMPUTE_PATH_TIMEOUT,
        Nav2ErrorCode.NO_VALID_PATH,
        Nav2ErrorCode.THROUGH_UNKNOWN,
        Nav2ErrorCode.THROUGH_TIMEOUT,
        Nav2ErrorCode.THROUGH_NO_VALID_PATH,
    }
)
"""Errors that clearing the global costmap may resolve: the defaults of WouldAPlannerRecoveryHelp."""

SMOOTHER_RECOVERY_HELPS: Final = frozenset(
    {
        Nav2ErrorCode.SMOOTH_UNKNOWN,
        Nav2ErrorCode.SMOOTH_TIMEOUT,
        Nav2ErrorCode.SMOOTHED_PATH_IN_COLLISION,
        Nav2ErrorCode.FAILED_TO_SMOOTH_PATH,
    }
)
"""Errors that another attempt of the smoother may resolve: the defaults of WouldASmootherRecoveryHelp."""
