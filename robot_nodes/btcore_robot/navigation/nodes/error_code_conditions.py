"""Nav2's conditions on the numbers by which servers say what went wrong."""

from typing import Annotated, ClassVar

from btcore import Condition, In
from btcore_robot.navigation.error_codes import (
    CONTROLLER_RECOVERY_HELPS,
    PLANNER_RECOVERY_HELPS,
    SMOOTHER_RECOVERY_HELPS,
)
from btcore_robot.navigation.nodes.port_access import OPTIONAL, optional_input

ROUTE_RECOVERY_HELPS = frozenset({400, 404, 405})
"""Nav2's numbers for a route server that knows not why, was too slow, or found no route."""

Number = Annotated[In[int], "What a server wrote; 0 when nothing went wrong."]
Numbers = Annotated[In[list[int]], "The numbers that count, in place of the usual ones."]


class AreErrorCodesPresent(Condition):
    """SUCCESS when *error_code* is one of *error_codes_to_check*."""

    error_code: Number
    error_codes_to_check: Numbers = OPTIONAL

    usual: ClassVar[frozenset[int]] = frozenset()

    def tick(self) -> bool:
        """Compare; an entry that nobody has written yet is no error."""
        code = optional_input(self, "error_code")
        asked = optional_input(self, "error_codes_to_check")
        counting = set(asked) if isinstance(asked, list | tuple) and asked else self.usual
        return isinstance(code, int | float) and int(code) in counting


class WouldAControllerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the controller failed in a way that clearing the local costmap may cure."""

    usual = frozenset(map(int, CONTROLLER_RECOVERY_HELPS))


class WouldAPlannerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the planner failed in a way that clearing the global costmap may cure."""

    usual = frozenset(map(int, PLANNER_RECOVERY_HELPS))


class WouldASmootherRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the smoother failed in a way that another try may cure."""

    usual = frozenset(map(int, SMOOTHER_RECOVERY_HELPS))


class WouldARouteRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when a route server failed in a way that another try may cure."""

    usual = ROUTE_RECOVERY_HELPS
