"""A server of Groot 2's protocol. It computes replies to requests, and uses no sockets."""

import time
import uuid
from collections import deque
from collections.abc import Callable, Sequence

from btcore.engine.node_config import MAX_NODES
from btcore.tree.tree import Tree
from btcore_monitor.serve.blackboards import ReservedNameError
from btcore_monitor.serve.hook_controller import HookController, RequestRejectedError
from btcore_monitor.serve.queueing_observer import TransitionItem
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot2 import Request, RequestHeader
from btcore_monitor.wire.nlohmann_json import JsonError


class Groot2Server:
    """Replies to requests about one tree. Only the publisher's thread may use it.

    Args:
        tree: The tree to serve.
        xml: The body of the reply to FULLTREE.
        create_boards_reply: Returns the body of the reply to BLACKBOARD for the requested names.
        tree_id: The UUID in each reply's header.
        hook_controller: Handles requests about hooks. Without it, such requests get an error reply.
    """

    def __init__(
        self,
        tree: Tree,
        xml: bytes,
        create_boards_reply: Callable[[list[str]], bytes],
        tree_id: uuid.UUID,
        hook_controller: HookController | None = None,
    ) -> None:
        self.hook_controller = hook_controller
        self._xml = xml
        self._create_boards_reply = create_boards_reply
        self._tree_id = tree_id.bytes
        # A uid has 16 bits on the wire: nodes beyond are neither in STATUS nor in recordings.
        nodes = [node for part in tree.subtrees for node in part.nodes if node.config.uid <= MAX_NODES]
        self._statuses = bytearray(
            groot2.encode_statuses((node.config.uid, int(node._status)) for node in nodes)
        )
        # A record has three bytes: the uid (2 bytes) and the code.
        self._code_offsets = {node.config.uid: 3 * index + 2 for index, node in enumerate(nodes)}
        self._recorded: deque[bytes] = deque(maxlen=groot2.MAX_RECORDED)
        self._recording_start_us = 0
        self._next_number: int | None = None
        self.dropped_transitions = 0
        """Transitions that were lost because the queue to this thread was full."""

    def add_transition(self, item: TransitionItem) -> None:
        """Update the node's status, and record the transition while a recording is on."""
        transition = item.transition
        if self._next_number is not None:
            self.dropped_transitions += transition.number - self._next_number
        self._next_number = transition.number + 1
        offset = self._code_offsets.get(transition.uid)
        if offset is None:
            return
        self._statuses[offset] = groot2.status_code(int(transition.previous), int(transition.status))
        if self._recording_start_us:
            offset_us = max(0, item.wall // 1000 - self._recording_start_us)
            self._recorded.append(groot2.encode_transition(offset_us, transition.uid, int(transition.status)))

    def correct_statuses(self, statuses: dict[int, int]) -> None:
        """Correct nodes with lost transitions. *statuses* are the tree's current statuses by uid."""
        for uid, status in statuses.items():
            offset = self._code_offsets.get(uid)
            if offset is None:
                continue
            code = self._statuses[offset]
            # A code of 10 or more means IDLE; code - 10 is the previous status.
            if (code if code < 10 else 0) != status:
                self._statuses[offset] = groot2.status_code(code if code < 10 else code - 10, status)

    def answer(self, frames: Sequence[bytes], client: bytes | None) -> list[bytes]:
        """Return the frames of the reply to a request. An invalid request gets an error reply.

        Args:
            client: The client's connection, or None if the client may not set hooks.
        """
        hook_controller = self.hook_controller
        if hook_controller is not None and client is not None:
            hook_controller.on_request(client)
        try:
            header = RequestHeader.decode(frames[0])
        except ProtocolError:
            return groot2.encode_error(groot2.WRONG_HEADER)
        try:
            kind = Request(header.kind)
        except ValueError:
            return groot2.encode_error(groot2.NOT_RECOGNIZED)
        # The letter of notifications, which clients must not send.
        if kind is Request.BREAKPOINT_REACHED:
            return groot2.encode_error(groot2.NOT_RECOGNIZED)
        if kind in groot2.TWO_FRAMES and len(frames) != 2:
            return groot2.encode_error(groot2.TWO_PARTS)
        try:
            if kind not in groot2.HOOKS:
                body = self._create_body(kind, frames)
            elif hook_controller is not None and client is not None:
                body = hook_controller.answer(client, kind, frames[1] if len(frames) > 1 else b"")
            else:
                return groot2.encode_error(
                    groot2.HOOKS_DISABLED if self.hook_controller is None else groot2.HOOKS_NEED_KEY
                )
        except (ReservedNameError, RequestRejectedError, JsonError) as error:
            return groot2.encode_error(str(error))
        return groot2.encode_reply(header, self._tree_id, body)

    def _create_body(self, kind: Request, frames: Sequence[bytes]) -> bytes | None:
        if kind is Request.FULLTREE:
            return self._xml
        if kind is Request.STATUS:
            return bytes(self._statuses)
        if kind is Request.BLACKBOARD:
            return self._create_boards_reply(groot2.decode_names(frames[1]))
        if kind is Request.TOGGLE_RECORDING:
            return self._toggle_recording(frames[1])
        # GET_TRANSITIONS empties the recording for all clients, as in groot2_publisher.cpp.
        recorded = b"".join(self._recorded)
        self._recorded.clear()
        return recorded

    def _toggle_recording(self, command: bytes) -> bytes | None:
        if command != b"start":
            self._recording_start_us = 0
            return None
        self._recorded.clear()
        self._recording_start_us = time.time_ns() // 1000
        return str(self._recording_start_us).encode()


def read_statuses(tree: Tree) -> dict[int, int]:
    """Return the current status of every node by uid. Any thread may call this function."""
    return {node.config.uid: int(node._status) for node in tree.nodes}
