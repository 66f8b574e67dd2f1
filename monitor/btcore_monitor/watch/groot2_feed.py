"""Follow a robot that supports only Groot 2's protocol, by polling.

The feed makes the robot record its transitions. It periodically requests the statuses, and then the recorded
transitions. Transitions that do not agree with the statuses are reported as a gap.

Each request for transitions empties the robot's buffer. So the feed requests only statuses if another client
requests transitions too, if the robot rejects the request, or if `record` is false. Then changes between
two requests are not seen, with one exception: the protocol sends the previous status of an idle node. After
some time the feed requests transitions again, because the other client may have left. With and without a
recording, the feed numbers the transitions itself, and `TreeEvent.has_transition_numbers` is false.

The robot keeps 1,000 transitions. The feed requests them so often that a batch is much smaller, also while a
big tree changes many nodes in one tick. If the buffer overflows anyway, the feed reports a gap and continues
with the transitions that the robot still has.
"""

import time
from collections.abc import Mapping
from itertools import pairwise
from typing import Final

from btcore_monitor.events import (
    BlackboardEvent,
    DataKind,
    DataSource,
    Event,
    HooksEvent,
    MissingDataEvent,
    ObservedTree,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.watch.blackboard_poller import BlackboardPoller
from btcore_monitor.watch.groot2_client import Groot2Client
from btcore_monitor.watch.hooks_warning import hooks_warning
from btcore_monitor.watch.recording_validator import CheckedBatch, RecordingValidator, RobotClockEstimate
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import (
    MAX_RECORDED,
    TRANSITION_SIZE,
    RecordedTransition,
    Reply,
    Request,
    StatusRecord,
    decode_recording_start,
    decode_statuses,
    decode_transitions,
)
from btcore_monitor.wire.hooks import decode_hooks

STATUS_INTERVAL_S: Final = 0.05
"""Seconds (wall clock) between two requests for statuses."""

MAX_GAPS: Final = 3
"""Gaps because of another client, after which the feed leaves the recording to that client for some time."""

RETRY_AFTER_S: Final = 10.0
"""Seconds (wall clock) after which the feed requests recorded transitions again. Each retry doubles them."""
_MAX_RETRY_AFTER_S: Final = 320.0

_FORGIVEN_AFTER_BATCHES: Final = 200
"""Batches without a gap after which earlier gaps no longer count."""

_MAX_WANTED_TRANSITIONS: Final = 250
"""Transitions in a batch above which requests become more frequent, because the robot keeps only 1,000."""
_SLOWER_AFTER_S: Final = 5.0
"""Seconds without a big batch after which requests become less frequent. Ticks may be seconds apart."""
_MIN_INTERVAL_S: Final = 0.002
_PAUSE_S: Final = 0.1
"""Seconds without a request after the tree was replaced."""
_MAX_CLOCK_ERROR_NS: Final = 1_000_000_000
"""Maximum error (ns) of the estimate of the robot's clock, in addition to the duration of a request."""

NOT_SENT: Final = "not sent by Groot 2"


class Groot2Feed:
    """Converts a robot's replies to events.

    Args:
        client: The client of the robot.
        blackboard_rate: How often blackboards are requested, in Hz (0: never).
        record: Whether the feed makes the robot record its transitions.
    """

    def __init__(self, client: Groot2Client, blackboard_rate: float, record: bool = True) -> None:
        self.client = client
        self.tree: ObservedTree | None = None
        self._may_record = self._is_recording_wanted = record
        self._no_recording_reason = ""
        self._retry_at = float("inf")
        self._retry_after = RETRY_AFTER_S
        self._tree_id = ""
        self._events: list[Event] = []  # those of the present step
        self._hooks_tree_id = ""
        self._needs_hooks = False
        self._records: dict[int, StatusRecord] | None = None
        self._observed: dict[int, StatusRecord] | None = None
        self._validator: RecordingValidator | None = None
        self._clock = RobotClockEstimate()
        self._blackboard_poller = BlackboardPoller(blackboard_rate)
        self._pending_request: Request | None = None
        self._paused_until = 0.0
        # When the last request was sent, and the request of the reply that is processed (ns, robot's clock).
        self._sent_at = self._requested_at = 0
        self._recording_start = 0
        self._drained_at = 0
        self._max_clock_error = _MAX_CLOCK_ERROR_NS
        self._reported_up_to = 0
        self._is_first_batch = True
        self._was_sampled = False
        self._is_reply_lost = False
        self._gap_count = self._complete_batches = 0
        self._last_number = 0
        self._status_interval = STATUS_INTERVAL_S
        self._big_batch_at = 0.0
        self._last_batch_size = 0
        self._next_status_at = 0.0

    def reset(self, pause: float = _PAUSE_S) -> None:
        """Forget the tree and request it again. The recording of an unchanged tree continues.

        Args:
            pause: Seconds until the next request.
        """
        # The robot may have sent transitions, and has removed them then.
        self._is_reply_lost |= self._pending_request is Request.GET_TRANSITIONS
        self._paused_until = time.monotonic() + pause
        self.tree = None
        self._records = None
        self._observed = None
        self._pending_request = None

    @property
    def is_following(self) -> bool:
        """Whether the robot's tree and its statuses are known."""
        return self.tree is not None and self._records is not None

    @property
    def is_behind(self) -> bool:
        """Whether the robot's buffer may overflow unless `step` is called again immediately."""
        return self._validator is not None and self._last_batch_size > _MAX_WANTED_TRANSITIONS

    @property
    def next_request_at(self) -> float:
        """When the next request is due (monotonic s); infinite while a reply is pending."""
        if self._pending_request is not None:
            return float("inf")
        if not self.is_following:
            return self._paused_until
        return min(self._next_status_at, self._blackboard_poller.next_request_at)

    def step(self, tree_only: bool = False) -> list[Event]:
        """Process a reply and send the next request, without waiting. Return the new events.

        Args:
            tree_only: Whether to request only the tree.

        Raises:
            NoReplyError: There is no reply within the timeout.
            RobotRefusedError: The robot rejected a request for its tree or its statuses.
            Groot1DetectedError: The robot replied in Groot 1's protocol.
            ProtocolError: A reply is invalid.
        """
        self._events = []
        if self.client.is_reply_pending:
            request = self._pending_request
            try:
                reply = self.client.receive_reply()
            except RobotRefusedError as error:
                self._pending_request = None
                if not self._continue_without(request, str(error)):
                    raise
            else:
                if reply is None:
                    return []
                self._pending_request = None
                self._requested_at = self._sent_at
                # While a reply is processed, a fast robot overwrites transitions. So the request that will
                # follow in any case is sent before.
                self._request_early(reply)
                try:
                    self._process_reply(reply)
                except ProtocolError as error:
                    reason = f"{self.client.address} sent an invalid reply: {error}"
                    if not self._continue_without(request, reason):
                        raise
        if not self.client.is_reply_pending:
            self._request(tree_only)
        return self._events

    def stop_recording(self) -> None:
        """Stop the recording that this feed started, without waiting for the reply."""
        if self.tree is not None and self._validator is not None:
            self.client.send_last_request(Request.TOGGLE_RECORDING, b"stop")

    # Requests

    def _request(self, tree_only: bool) -> None:
        now = time.monotonic()
        if now < self._paused_until:
            return
        if self.tree is None:
            self._send_request(Request.FULLTREE)
        # The run channel may still connect, and needs no recording.
        elif tree_only:
            pass
        elif self._observed is not None:
            self._send_request(Request.GET_TRANSITIONS)
        elif (
            self._records is not None
            and self._validator is None
            and (self._is_recording_wanted or now >= self._retry_at)
        ):
            self._send_request(Request.TOGGLE_RECORDING, b"start")
        elif self._needs_hooks:
            self._needs_hooks = False
            self._send_request(Request.HOOKS_DUMP)
        elif self._records is None or self._blackboard_poller.next_request_at >= self._next_status_at <= now:
            # Statuses before recorded transitions: a batch must contain all transitions up to the statuses.
            self._next_status_at = now + self._status_interval
            self._send_request(Request.STATUS)
        elif self._blackboard_poller.next_request_at <= now:
            self._send_request(Request.BLACKBOARD, self._blackboard_poller.create_request(now))

    def _request_early(self, reply: Reply) -> None:
        if self.tree is None or reply.tree_id != self.tree.tree_id or self._validator is None:
            return
        if reply.kind == Request.STATUS:
            self._send_request(Request.GET_TRANSITIONS)
        elif (
            reply.kind == Request.GET_TRANSITIONS
            and len(reply.body) > _MAX_WANTED_TRANSITIONS * TRANSITION_SIZE
        ):
            # Probably in the middle of a tick.
            self._send_request(Request.STATUS)

    def _send_request(self, kind: Request, body: bytes | None = None) -> None:
        self._pending_request = kind
        self._sent_at = self._clock.wall()
        self.client.send_request(kind, body)

    # Replies

    def _process_reply(self, reply: Reply) -> None:
        # Every reply has the tree's ID. Another ID means that the robot has restarted or replaced its tree.
        if self.tree is None or reply.tree_id != self.tree.tree_id:
            self.reset()
            if reply.kind == Request.FULLTREE:
                self._begin_tree(read_fulltree(reply.body, reply.tree_id))
                self._paused_until = 0.0
            return
        if reply.kind == Request.STATUS:
            self._process_statuses(decode_statuses(reply.body))
        elif reply.kind == Request.BLACKBOARD:
            boards = self._blackboard_poller.store_reply(reply.body)
            if boards is not None:
                wall = self._clock.wall()
                self._events.append(BlackboardEvent(self._clock.stamp(wall), wall, boards))
        elif reply.kind == Request.GET_TRANSITIONS:
            # Until the transitions are decoded, because the robot no longer has them.
            self._is_reply_lost, lost = True, self._is_reply_lost
            batch = decode_transitions(reply.body)
            self._is_reply_lost = lost
            self._process_batch(batch)
        elif reply.kind == Request.HOOKS_DUMP:
            self._warn_of_hooks(reply.body)
        elif reply.kind == Request.TOGGLE_RECORDING and reply.body:
            # µs on the wire, ns in events
            self._begin_recording(1000 * decode_recording_start(reply.body))

    def _begin_tree(self, tree: ObservedTree) -> None:
        self.tree = tree
        self._blackboard_poller.begin(tree)
        if tree.tree_id == self._tree_id:
            return
        self._tree_id = tree.tree_id
        self._validator = None
        self._is_recording_wanted = self._may_record
        self._no_recording_reason = "" if self._is_recording_wanted else "--no-record"
        self._is_first_batch = True
        self._was_sampled = self._is_reply_lost = False
        self._gap_count = self._complete_batches = self._last_number = self._reported_up_to = 0
        self._status_interval = STATUS_INTERVAL_S
        self._retry_at, self._retry_after = float("inf"), RETRY_AFTER_S
        self._clock.begin(self._clock.wall())

    def _process_statuses(self, observed: dict[int, StatusRecord]) -> None:
        assert self.tree is not None
        observed = {uid: record for uid, record in observed.items() if uid in self.tree.by_uid}
        before, self._records = self._records, observed
        if self._validator is not None:
            self._observed = observed
        elif before is not None:
            self._report_differences(before, observed)
        elif not self._is_recording_wanted:
            self._report_tree(self._clock.wall(), observed)

    def _begin_recording(self, wall: int) -> None:
        """Begin a recording that starts at *wall* (ns, robot's clock). The first batch shows the tree."""
        assert self._records is not None
        answered_at = self._clock.wall()
        # The robot took its time between request and reply; the middle halves the maximum error.
        self._clock.set(wall, (self._requested_at + answered_at) // 2)
        self._max_clock_error = _MAX_CLOCK_ERROR_NS + answered_at - self._requested_at
        if self._is_first_batch:
            self._clock.begin(wall)
        self._recording_start = self._drained_at = wall
        self._was_sampled = not self._is_recording_wanted
        self._is_recording_wanted, self._no_recording_reason, self._retry_at = True, "", float("inf")
        self._validator = RecordingValidator(self._records)
        self._next_status_at = 0.0

    def _report_tree(self, wall: int, records: Mapping[int, StatusRecord]) -> None:
        assert self.tree is not None
        statuses = {node.uid: 0 for node in self.tree.nodes}
        statuses |= {uid: record.status for uid, record in records.items()}
        self._reported_up_to = max(self._reported_up_to, self._clock.stamp(wall))
        results = {
            uid: record.previous for uid, record in records.items() if record.status == 0 and record.previous
        }
        self._events.append(
            TreeEvent(self.tree, self._reported_up_to, wall, statuses, False, self._create_source(), results)
        )
        if self._hooks_tree_id != self._tree_id:
            self._hooks_tree_id = self._tree_id
            self._needs_hooks = True

    def _create_source(self) -> DataSource:
        rate = self._blackboard_poller.rate
        polled = f"requested {rate:g} times a second: short changes are not seen"
        unavailable: dict[DataKind, str] = {
            "ticks": NOT_SENT,
            "exceptions": NOT_SENT,
            "blackboard": polled if rate else "not requested",
        }
        if self._validator is not None:
            return DataSource("Groot 2, recorded", unavailable)
        reason = f" ({self._no_recording_reason})" if self._no_recording_reason else ""
        unavailable["transitions"] = (
            f"statuses are requested {1 / STATUS_INTERVAL_S:g} times a second{reason}: "
            "short changes are not seen"
        )
        return DataSource("Groot 2, sampled", unavailable)

    # Events

    def _warn_of_hooks(self, dump: bytes) -> None:
        """Report hooks in the robot. The feed sets no hooks, so other clients have set all of them."""
        assert self.tree is not None
        nodes = self.tree.by_uid
        try:
            hooks = decode_hooks(dump)
        except ProtocolError as error:
            warning = f"warning: the robot's list of hooks is invalid: {error}"
        else:
            if not hooks:
                return
            warning = hooks_warning(
                hooks, lambda uid: nodes[uid].path if uid in nodes else f"node {uid}", self.client.address
            )
        wall = self._clock.wall()
        self._events.append(HooksEvent(self._clock.stamp(wall), wall, warning))

    def _report_differences(
        self, before: Mapping[int, StatusRecord], observed: Mapping[int, StatusRecord]
    ) -> None:
        wall = self._clock.wall()
        for uid, record in observed.items():
            old = before.get(uid, StatusRecord(0, 0))
            if record == old:
                continue
            steps = [old.status, record.status]
            if record.status == 0 and record.previous not in (0, old.status):
                steps.insert(1, record.previous)  # the node had this status between the two requests
            for previous, status in pairwise(steps):
                if status != previous:
                    self._report_transition(wall, uid, previous, status)

    def _report_transition(self, wall: int, uid: int, previous: int, status: int) -> None:
        self._last_number += 1
        self._reported_up_to = max(self._reported_up_to, self._clock.stamp(wall))
        self._events.append(
            TransitionEvent(self._last_number, self._reported_up_to, wall, 0, uid, previous, status)
        )

    def _process_batch(self, batch: list[RecordedTransition]) -> None:
        """Process the transitions that the robot recorded since the previous batch."""
        assert self._validator is not None
        assert self._observed is not None
        observed, self._observed = self._observed, None
        drained_at, self._drained_at = self._drained_at, self._requested_at
        if batch and self._recording_start + 1000 * batch[0].offset < drained_at - self._max_clock_error:
            # Offsets count from the start of the recording, which another client's `start` moves.
            reason = "another client began a recording of this robot, or its clock was set"
            self._leave_recording(observed, reason)
            return
        known = self._validator.statuses
        checked = self._validator.apply(observed, batch)
        self._choose_interval(len(batch))
        # The time of the first transition: statuses of nodes that changed in a gap are shown just before it.
        wall = self._recording_start + 1000 * batch[0].offset if batch else self._requested_at
        if self._is_first_batch:
            self._report_tree(wall if checked.is_overflow else self._recording_start, checked.before)
        elif not checked.is_complete:
            if not self._report_missing(checked, wall):
                return
        elif self._was_sampled:
            self._report_gap("short changes before this time were not seen in the samples", wall)
            self._report_tree(wall, checked.before)
        else:
            for uid, record in checked.before.items():
                if record.status != known[uid].status:
                    self._report_transition(drained_at, uid, known[uid].status, record.status)
        self._is_first_batch = self._was_sampled = self._is_reply_lost = False
        for transition, previous in checked.steps:
            at = self._recording_start + 1000 * transition.offset
            self._report_transition(at, transition.uid, previous, transition.status)
        if checked.is_complete:
            self._complete_batches += bool(checked.steps)
            if self._complete_batches >= _FORGIVEN_AFTER_BATCHES:
                self._gap_count = self._complete_batches = 0
                self._retry_after = RETRY_AFTER_S

    def _choose_interval(self, size: int) -> None:
        """Choose the time to the next request after a batch of *size* transitions."""
        now = time.monotonic()
        self._last_batch_size = size
        if size > _MAX_WANTED_TRANSITIONS:
            self._big_batch_at = now
            # A full buffer may have had any number of transitions.
            self._status_interval *= _MAX_WANTED_TRANSITIONS / size if size < MAX_RECORDED else 0
            self._status_interval = max(_MIN_INTERVAL_S, self._status_interval)
        elif now - self._big_batch_at > _SLOWER_AFTER_S:
            self._status_interval = min(STATUS_INTERVAL_S, 2 * self._status_interval)

    def _report_missing(self, checked: CheckedBatch, wall: int) -> bool:
        """Report that transitions are missing. Return false if the feed leaves the recording."""
        assert self._validator is not None
        if self._is_reply_lost:
            reason = "a reply of the robot with its recorded transitions did not arrive"
        elif checked.is_overflow:
            reason = (
                f"more than {MAX_RECORDED} statuses changed between two requests, and the robot keeps "
                "only the last ones"
            )
        else:
            self._gap_count += 1
            self._complete_batches = 0
            reason = "another client reads this robot's recording too"
            if self._gap_count >= MAX_GAPS:
                self._leave_recording(self._validator.statuses, reason)
                return False
        self._report_gap(reason, wall)
        self._report_tree(wall, checked.before)
        return True

    def _leave_recording(self, records: dict[int, StatusRecord], reason: str) -> None:
        """Leave the recording to another client, and continue with statuses only until the next retry."""
        self._no_recording_reason = f"{reason}; next attempt to read it in {self._retry_after:g} s"
        self._report_gap(f"{reason}: statuses are sampled for {self._retry_after:g} s", self._requested_at)
        self._retry_at = time.monotonic() + self._retry_after
        self._retry_after = min(_MAX_RETRY_AFTER_S, 2 * self._retry_after)
        # The next gap because of another client ends the retry.
        self._gap_count = MAX_GAPS - 1
        self._complete_batches = 0
        self._is_recording_wanted = False
        self._validator = None
        self._records = records
        self._report_tree(self._requested_at, records)
        self._is_first_batch = False

    def _report_gap(self, reason: str, wall: int) -> None:
        """Report that transitions before *wall* (ns, robot's clock) are missing."""
        if not self._is_first_batch:
            stamp = max(self._reported_up_to, self._clock.stamp(wall))
            self._events.append(MissingDataEvent(stamp, wall, self._reported_up_to, "transitions", reason))

    def _continue_without(self, request: Request | None, reason: str) -> bool:
        """Continue without data that the robot does not send. Return false if the data is necessary."""
        if request is Request.BLACKBOARD:
            wall = self._clock.wall()
            stamp = self._clock.stamp(wall)
            names = self._blackboard_poller.adapt_to_rejection()
            self._events.extend(
                MissingDataEvent(stamp, wall, stamp, "blackboard", f"{name} isn't shown: {reason}")
                for name in names
            )
        elif request in (Request.TOGGLE_RECORDING, Request.GET_TRANSITIONS) and self._records is not None:
            self._is_recording_wanted = False
            self._validator = self._observed = None
            self._no_recording_reason = reason
            self._report_tree(self._clock.wall(), self._records)
        else:
            # A robot may refuse to list its hooks, for example a btcore robot without control.
            return request is Request.HOOKS_DUMP
        return True
