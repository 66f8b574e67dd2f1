"""Nav2's tree nodes under Nav2's names, served by this navigation stack.

``btcore.nodes`` is the entry-point group by which the engine finds this library.
"""

from btcore import Registry
from btcore_robot.leaves.pose_types import register_pose_type
from btcore_robot.navigation.nodes import (
    conditions,
    control,
    decorators,
    error_code_conditions,
    goals,
    motion,
    paths,
    planning,
    services,
)

LIBRARY = (
    control.NonblockingSequence,
    control.PersistentSequence,
    control.PipelineSequence,
    control.RecoveryNode,
    control.RoundRobin,
    decorators.DistanceController,
    decorators.GoalUpdatedController,
    decorators.GoalUpdater,
    decorators.PathLongerOnApproach,
    decorators.RateController,
    decorators.SingleTrigger,
    decorators.SpeedController,
    conditions.ArePosesNear,
    conditions.DistanceTraveled,
    conditions.GlobalUpdatedGoal,
    conditions.GoalReached,
    conditions.GoalUpdated,
    conditions.InitialPoseReceived,
    conditions.IsBatteryCharging,
    conditions.IsBatteryLow,
    conditions.IsGoalNearby,
    conditions.IsStuck,
    conditions.IsWithinPathTrackingBounds,
    conditions.PathExpiringTimer,
    conditions.TimeExpired,
    conditions.TransformAvailable,
    error_code_conditions.AreErrorCodesPresent,
    error_code_conditions.WouldAControllerRecoveryHelp,
    error_code_conditions.WouldAPlannerRecoveryHelp,
    error_code_conditions.WouldARouteRecoveryHelp,
    error_code_conditions.WouldASmootherRecoveryHelp,
    goals.AppendGoalPoseToGoals,
    goals.CheckPoseOccupancy,
    goals.GetNextFewGoals,
    goals.RemoveInCollisionGoals,
    goals.RemovePassedGoals,
    motion.BackUp,
    motion.DriveOnHeading,
    motion.FollowPath,
    motion.NavigateThroughPoses,
    motion.NavigateToPose,
    motion.Spin,
    motion.Wait,
    planning.ComputePathThroughPoses,
    planning.ComputePathToPose,
    paths.ConcatenatePaths,
    paths.GetCurrentPose,
    paths.GetPoseFromPath,
    paths.IsPathValid,
    paths.SmoothPath,
    paths.TruncatePath,
    paths.TruncatePathLocal,
    paths.ValidatePath,
    services.CancelBackUp,
    services.CancelControl,
    services.CancelDriveOnHeading,
    services.CancelSpin,
    services.CancelWait,
    services.CheckStopStatus,
    services.ClearCostmapAroundPose,
    services.ClearCostmapAroundRobot,
    services.ClearCostmapExceptRegion,
    services.ClearEntireCostmap,
    services.ControllerSelector,
    services.GoalCheckerSelector,
    services.PathHandlerSelector,
    services.PlannerSelector,
    services.ProgressCheckerSelector,
    services.ReinitializeGlobalLocalization,
    services.SmootherSelector,
)
"""Every node class of the library."""


def register(nodes: Registry) -> None:
    """Register every node of this library and the type of their poses."""
    register_pose_type(nodes)
    nodes.add(*LIBRARY)
