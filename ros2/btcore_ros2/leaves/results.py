"""Checks of the statuses that callbacks of leaves return."""

from typing import Any

from btcore import FAILURE, SUCCESS, NodeError, Status


def completed(status: Any, callback: str, expected: str = "SUCCESS or FAILURE") -> Status:
    """Return *status* as SUCCESS or FAILURE.

    Args:
        status: What the callback returned.
        callback: The name of the callback, for the message.
        expected: The statuses that the callback may return, for the message.

    Raises:
        NodeError: The callback returned anything else.
    """
    if status is True or status is SUCCESS:
        return SUCCESS
    if status is False or status is FAILURE:
        return FAILURE
    text = status.name if isinstance(status, Status) else repr(status)
    raise NodeError(f"{callback} must return {expected} (or True or False), not {text}")
