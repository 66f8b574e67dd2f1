"""Nav2's conditions on the error codes of servers."""

from typing import Annotated, ClassVar

from btcore import Condition, In
from btcore_robot.navigation.error_codes import (
    CONTROLLER_RECOVERY_HELPS,
    PLANNER_RECOVERY_HELPS,
    SMOOTHER_RECOVERY_HELPS,
)
from btcore_robot.navigation.nodes.port_access import OPTIONAL, optional_input

ROUTE_RECOVERY_HELPS = frozenset({400, 404, 405})
"""Nav2's codes of a route server's errors: unknown error, timeout, no valid route."""

ErrorCode = Annotated[In[int], "Error code; 0 when there was no error."]
ErrorCodes = Annotated[In[list[int]], "Error codes to check in place of the default codes."]


class AreErrorCodesPresent(Condition):
    """SUCCESS when *error_code* is one of *error_codes_to_check*."""

    error_code: ErrorCode
    error_codes_to_check: ErrorCodes = OPTIONAL

    default_codes: ClassVar[frozenset[int]] = frozenset()

    def tick(self) -> bool:
        """Compare the code; an entry without a value is no error."""
        code = optional_input(self, "error_code")
        given = optional_input(self, "error_codes_to_check")
        codes = set(given) if isinstance(given, list | tuple) and given else self.default_codes
        return isinstance(code, int | float) and int(code) in codes


class WouldAControllerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the controller failed with an error that clearing the local costmap may resolve."""

    default_codes = frozenset(map(int, CONTROLLER_RECOVERY_HELPS))


class WouldAPlannerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the planner failed with an error that clearing the global costmap may resolve."""

    default_codes = frozenset(map(int, PLANNER_RECOVERY_HELPS))


class WouldASmootherRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the smoother failed with an error that a retry may resolve."""

    default_codes = frozenset(map(int, SMOOTHER_RECOVERY_HELPS))


class WouldARouteRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when a route server failed with an error that a retry may resolve."""

    default_codes = ROUTE_RECOVERY_HELPS
