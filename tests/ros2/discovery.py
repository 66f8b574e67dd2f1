"""Waiting until a server knows a client: what it sends to an unknown client is lost."""

from typing import Any

from action_msgs.srv import CancelGoal

from tests.ros2.conftest import LIMIT_S


def wait_until_known(session: Any, action: str) -> None:
    """Wait until the server of *action* knows all clients that *session* has created before."""
    request = CancelGoal.Request()
    request.goal_info.goal_id.uuid[0] = 1  # a goal that does not exist
    wait_until_service_knows(session, f"{action}/_action/cancel_goal", CancelGoal, request)


def wait_until_service_knows(session: Any, service: str, service_type: Any, request: Any) -> None:
    """Wait until the server of *service*, which gets *request*, knows all clients of *session*.

    A client sees that a server is ready, but not whether the server has found the client. DDS announces the
    entities of a process in order, so that a response to a new client shows that those before it are known.
    """
    client = session.node.create_client(service_type, service)
    assert session.wait_for(client.service_is_ready, LIMIT_S), service

    def responds() -> bool:
        future = client.call_async(request)
        answered: bool = session.wait_for(future.done, LIMIT_S / 20)
        client.remove_pending_request(future)
        return answered

    assert session.wait_for(responds, LIMIT_S), service
    session.node.destroy_client(client)
