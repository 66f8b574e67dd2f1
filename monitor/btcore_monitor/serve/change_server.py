"""Changes of a running tree that clients request: of entries of its blackboards, and of the tree itself.

The publisher's thread receives a request and sends the reply. The thread that ticks executes the change in
between, before a tick. Of a tick that is stopped at a breakpoint, the publisher's thread does so.
"""

import time
from collections.abc import Sequence
from typing import Final

from btcore.blackboard.entry_texts import value_from_text
from btcore.suggestions import did_you_mean
from btcore.tree.tree import Tree
from btcore_monitor.serve import change_queue
from btcore_monitor.serve.change_queue import Change, ChangeQueue
from btcore_monitor.serve.hook_controller import RequestRejectedError
from btcore_monitor.serve.published_tree import PublishedTree
from btcore_monitor.serve.request_socket import RequestSocket
from btcore_monitor.wire import groot2
from btcore_monitor.wire.changes import (
    BREAKPOINTS,
    MAX_VALUE_CHARS,
    MAX_XML_BYTES,
    RELOAD,
    VALUES,
    ChangeRequest,
    NewValue,
    decode_new_value,
    encode_refusals,
)
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot2 import RequestHeader

NEEDS_OPTION: Final = "the robot does not allow changes: start it with --allow-control --allow-changes"
NEEDS_RUN: Final = "only `btcore run` can reload its tree: this program ticks the tree itself"


class ChangeServer:
    """Receives requests for changes, and replies to them when they were executed.

    Only the publisher's thread may use it, except for `reloads`.

    Args:
        is_allowed: Whether clients may change the tree.
        allows_breakpoints: Whether clients may set breakpoints.

    Attributes:
        reloads: The trees that clients send.
    """

    def __init__(self, is_allowed: bool, allows_breakpoints: bool) -> None:
        self.reloads = ChangeQueue()
        self._is_allowed = is_allowed
        self._allows_breakpoints = allows_breakpoints
        self._pending: list[tuple[Change, RequestSocket, Sequence[bytes], RequestHeader, bytes]] = []

    def receive(
        self,
        requests: RequestSocket,
        frames: Sequence[bytes],
        published: PublishedTree,
        may_control: bool,
    ) -> bool:
        """Handle a request for a change, and return whether *frames* is one.

        Args:
            requests: The socket from which the request came.
            may_control: Whether the client may control the tree.
        """
        try:
            header = RequestHeader.decode(frames[0])
            kind = ChangeRequest(header.kind)
        except (ProtocolError, ValueError):
            return False
        refusals, tree_id = self._list_refusals(may_control), bytes.fromhex(published.tree_id)
        if kind is ChangeRequest.REFUSALS:
            requests.answer(groot2.encode_reply(header, tree_id, encode_refusals(refusals)))
            return True
        try:
            if reason := refusals[VALUES if kind is ChangeRequest.SET_ENTRY else RELOAD]:
                raise RequestRejectedError(reason)
            if len(frames) != 2:
                raise RequestRejectedError(groot2.TWO_PARTS)
            if kind is ChangeRequest.SET_ENTRY:
                change = _change_of_entry(published.tree, decode_new_value(frames[1]))
                published.entry_changes.add(change)
            else:
                change = _change_of_tree(published.tree, frames[1])
                self.reloads.add(change)
            self._pending.append((change, requests, requests.envelope, header, tree_id))
        except (RequestRejectedError, ProtocolError) as error:
            requests.answer(groot2.encode_error(str(error)))
        return True

    def _list_refusals(self, may_control: bool) -> dict[str, str]:
        if not may_control:
            return dict.fromkeys((BREAKPOINTS, VALUES, RELOAD), groot2.HOOKS_NEED_KEY)
        refusal = "" if self._is_allowed else NEEDS_OPTION
        return {
            BREAKPOINTS: "" if self._allows_breakpoints else groot2.HOOKS_DISABLED,
            VALUES: refusal,
            RELOAD: refusal or ("" if self.reloads.is_used else NEEDS_RUN),
        }

    def send_replies(self, entries: ChangeQueue) -> None:
        """Send the replies to requests that were executed, or that waited too long.

        Args:
            entries: The changes of entries of the published tree.
        """
        if not self._pending:
            return
        for queue in (entries, self.reloads):
            queue.refuse(
                f"nothing was changed: the tree began no tick within {change_queue.MAX_WAIT_S:g} s",
                time.monotonic(),
            )
        pending, self._pending = self._pending, []
        for item in pending:
            change, requests, envelope, header, tree_id = item
            if change.result is None:
                self._pending.append(item)
            elif change.result:
                requests.answer(groot2.encode_error(change.result), envelope)
            else:
                requests.answer(groot2.encode_reply(header, tree_id), envelope)

    def close(self) -> None:
        """Refuse the changes that wait for another tree."""
        self.reloads.refuse("the run has ended")


def _change_of_entry(tree: Tree, new: NewValue) -> Change:
    """Return the change that sets an entry.

    Raises:
        RequestRejectedError: There is no such entry, or the text is not a value of its type.
    """
    boards = {part.path: part.blackboard for part in tree.subtrees}
    board = boards.get(new.path)
    if board is None:
        raise RequestRejectedError(f"the tree has no subtree '{new.path}'{did_you_mean(new.path, boards)}")
    if len(new.text) > MAX_VALUE_CHARS:
        raise RequestRejectedError(f"the value is longer than {MAX_VALUE_CHARS:,} characters")
    entry = board.local_entries().get(new.key)
    if entry is None:
        hint = did_you_mean(new.key, list(board.local_entries()))
        raise RequestRejectedError(f"the blackboard has no entry '{new.key}'{hint}")
    # An entry without a type stays without one: another value may follow, also of a script.
    declared = entry.declared
    try:
        value = value_from_text(new.text, declared if declared.strong else None, tree.format)
    # The conversion of a user's type may raise anything.
    except Exception as error:
        raise RequestRejectedError(f"'{new.key}' is not set: {error}") from None
    return Change(execute=lambda: board.set(new.key, value, declared))


def _change_of_tree(tree: Tree, body: bytes) -> Change:
    """Return the change that replaces the tree.

    Raises:
        RequestRejectedError: The text is too large or not UTF-8, or the tree waits at a breakpoint.
    """
    if len(body) > MAX_XML_BYTES:
        raise RequestRejectedError(f"the XML has more than {MAX_XML_BYTES:,} bytes")
    try:
        text = body.decode()
    except UnicodeDecodeError:
        raise RequestRejectedError("the XML is not UTF-8") from None
    if tree.hooks.call_while_stopped(lambda: None):
        raise RequestRejectedError("the tree waits at a breakpoint: let it continue, then reload")
    return Change(text)
