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
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, TypeVar

from btcore_monitor.errors import MonitorError
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
from btcore_monitor.watch.recording_validator import RecordingValidator, RobotClockEstimate
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.groot2 import (
    MAX_RECORDED,
    RecordedTransition,
    Request,
    StatusRecord,
    decode_recording_start,
    decode_statuses,
    decode_transitions,
)
from btcore_monitor.wire.hooks import decode_hooks
from btcore_monitor.wire.msgpack_values import decode_boards

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
_MAX_CLOCK_ERROR_NS: Final = 1_000_000_000
"""Maximum error (ns) of the estimate of the robot's clock, in addition to the duration of a request."""

NOT_SENT: Final = "not sent by Groot 2"

T = TypeVar("T")
_Steps = Generator[None, None, T]
"""A function in steps, with the result T: it yields whenever it waits for a reply or for a time."""


class TreeReplacedError(MonitorError):
    """The robot has another tree than the followed tree, because it has restarted or replaced its tree."""


class _UnavailableDataError(ProtocolError):
    """The robot rejected a request, or its reply is invalid."""


@dataclass(slots=True)
class _Recording:
    """A recording that the feed has started in the robot.

    Attributes:
        start: When the recording started (ns, robot's clock).
        max_clock_error: Maximum error (ns) of the estimate of the robot's clock.
        validator: The check of the transitions.
        gaps_left: Gaps because of another client, after which the feed leaves the recording.
        drained_at: When the transitions were requested last (ns, robot's clock).
        interval: Seconds between two batches.
        is_new: Whether no batch has been processed yet.
        is_reply_lost: Whether the robot may have sent transitions that did not arrive. It no longer has them.
        is_behind: Whether the last batch was so big that the next batch is requested at once.
        big_batch_at: When the last big batch arrived (monotonic s).
        complete_batches: The number of batches with transitions since the last gap because of another client.
    """

    start: int
    max_clock_error: int
    validator: RecordingValidator
    gaps_left: int
    drained_at: int
    interval: float
    is_new: bool = True
    is_reply_lost: bool = False
    is_behind: bool = False
    big_batch_at: float = 0.0
    complete_batches: int = 0

    def wall(self, transition: RecordedTransition) -> int:
        """Return the time of *transition* (ns, robot's clock)."""
        return self.start + 1000 * transition.offset

    def adapt_interval(self, size: int) -> None:
        """Choose the time to the next batch after a batch of *size* transitions."""
        now = time.monotonic()
        self.is_behind = size > _MAX_WANTED_TRANSITIONS
        if self.is_behind:
            self.big_batch_at = now
            # A full buffer may have had any number of transitions.
            self.interval *= _MAX_WANTED_TRANSITIONS / size if size < MAX_RECORDED else 0
            self.interval = max(_MIN_INTERVAL_S, self.interval)
        elif now - self.big_batch_at > _SLOWER_AFTER_S:
            self.interval = min(STATUS_INTERVAL_S, 2 * self.interval)


class Groot2Feed:
    """Follows one tree of a robot: sends requests, and converts the replies to events.

    Args:
        client: The client of the robot.
        tree: The robot's tree.
        blackboard_rate: How often blackboards are requested, in Hz (0: never).
        record: Whether the feed makes the robot record its transitions.
    """

    def __init__(
        self, client: Groot2Client, tree: ObservedTree, blackboard_rate: float, record: bool = True
    ) -> None:
        self.tree = tree
        self._client = client
        self._blackboard_rate = blackboard_rate
        self._clock = RobotClockEstimate()
        self._events: list[Event] = []  # those of the present step
        self._recording: _Recording | None = None
        # When to start a recording, if there is none (monotonic s).
        self._record_at = 0.0 if record else float("inf")
        self._retry_after = RETRY_AFTER_S
        self._no_recording_reason = "" if record else "--no-record"
        self._is_reported = False
        self._reported_up_to = 0
        self._last_number = 0
        self.resume()

    def resume(self) -> None:
        """Begin or, after an error of `step`, continue to follow the tree. A recording continues."""
        self.is_following = False
        """Whether the robot has sent its statuses."""
        self._statuses: dict[int, StatusRecord] | None = None
        self._blackboard_poller = BlackboardPoller(self.tree, self._blackboard_rate)
        self._next_request_at = 0.0
        self._follower = self._follow()

    def __str__(self) -> str:
        return f"{self._client.address}, by Groot 2's protocol"

    @property
    def is_behind(self) -> bool:
        """Whether the robot's buffer may overflow unless `step` is called again immediately."""
        return self._recording is not None and self._recording.is_behind

    @property
    def next_step_at(self) -> float:
        """When the next step is due (monotonic s), unless a reply arrives before."""
        return float("inf") if self._client.is_reply_pending else self._next_request_at

    def step(self) -> list[Event]:
        """Process a reply and send the next request, without waiting. Return the new events.

        After an exception, `resume` must be called before the next step.

        Raises:
            TreeReplacedError: The robot has another tree.
            NoReplyError: There is no reply within the timeout.
            Groot1DetectedError: The robot replied in Groot 1's protocol.
            ProtocolError: A reply is invalid, or the robot rejected a request for its statuses.
        """
        self._events = []
        next(self._follower)
        return self._events

    def stop_recording(self) -> None:
        """Stop the recording that this feed started, without waiting for the reply."""
        if self._recording is not None:
            self._client.send_last_request(Request.TOGGLE_RECORDING, b"stop")

    # Requests

    def _follow(self) -> _Steps[None]:
        while True:
            requested_at = time.monotonic()
            if self._recording is None and requested_at >= self._record_at:
                yield from self._start_recording()
            was_reported = self._is_reported
            if self._recording is None:
                yield from self._sample()
            else:
                yield from self._read_recording(self._recording)
            if not was_reported:
                yield from self._request_hooks()
            interval = STATUS_INTERVAL_S if self._recording is None else self._recording.interval
            # After a big batch at once: the robot is probably in the middle of a tick.
            next_at = requested_at + (0 if self.is_behind else interval)
            while self._blackboard_poller.next_request_at < next_at:
                yield from self._wait(self._blackboard_poller.next_request_at)
                yield from self._request_blackboards()
            yield from self._wait(next_at)

    def _wait(self, until: float) -> _Steps[None]:
        self._next_request_at = until
        while time.monotonic() < until:
            yield

    def _request(self, kind: Request, decode: Callable[[bytes], T], body: bytes | None = None) -> _Steps[T]:
        """Send a request, and return the decoded reply."""
        self._client.send_request(kind, body)
        reply = None
        try:
            while reply is None:
                yield
                reply = self._client.receive_reply()
        except RobotRefusedError as error:
            raise _UnavailableDataError(str(error)) from None
        if reply.tree_id != self.tree.tree_id:
            raise TreeReplacedError(f"{self._client.address} has another tree")
        try:
            return decode(reply.body)
        except ProtocolError as error:
            raise _UnavailableDataError(f"{self._client.address} sent an invalid reply: {error}") from None

    def _request_statuses(self) -> _Steps[dict[int, StatusRecord]]:
        statuses = yield from self._request(Request.STATUS, decode_statuses)
        self.is_following = True
        return {uid: record for uid, record in statuses.items() if uid in self.tree.by_uid}

    def _request_blackboards(self) -> _Steps[None]:
        poller = self._blackboard_poller
        names = poller.create_request(time.monotonic())
        try:
            received = yield from self._request(Request.BLACKBOARD, decode_boards, names)
        except _UnavailableDataError as error:
            wall = self._clock.wall()
            stamp = self._clock.stamp(wall)
            self._events.extend(
                MissingDataEvent(stamp, wall, stamp, "blackboard", f"{name} isn't shown: {error}")
                for name in poller.adapt_to_rejection()
            )
            return
        boards = poller.store_reply(received)
        if boards is not None:
            wall = self._clock.wall()
            self._events.append(BlackboardEvent(self._clock.stamp(wall), wall, boards))

    def _request_hooks(self) -> _Steps[None]:
        """Report hooks in the robot. The feed sets no hooks, so other clients have set all of them."""
        nodes = self.tree.by_uid
        try:
            dump = yield from self._request(Request.HOOKS_DUMP, bytes)
        except _UnavailableDataError:
            # A robot may refuse to list its hooks, for example a btcore robot without control.
            return
        try:
            hooks = decode_hooks(dump)
        except ProtocolError as error:
            warning = f"warning: the robot's list of hooks is invalid: {error}"
        else:
            if not hooks:
                return
            warning = hooks_warning(
                hooks, lambda uid: nodes[uid].path if uid in nodes else f"node {uid}", self._client.address
            )
        wall = self._clock.wall()
        self._events.append(HooksEvent(self._clock.stamp(wall), wall, warning))

    def _sample(self) -> _Steps[None]:
        """Report the differences to the statuses that were requested before."""
        statuses = yield from self._request_statuses()
        before, self._statuses = self._statuses, statuses
        if before is None:
            self._report_tree(self._clock.wall(), statuses)
        else:
            self._report_differences(before, statuses)

    def _start_recording(self) -> _Steps[None]:
        statuses = yield from self._request_statuses()
        requested_at = self._clock.wall()
        try:
            micros = yield from self._request(Request.TOGGLE_RECORDING, decode_recording_start, b"start")
        except _UnavailableDataError as error:
            self._sample_only(statuses, str(error), self._clock.wall())
            return
        start = 1000 * micros
        answered_at = self._clock.wall()
        # The robot took its time between request and reply; the middle halves the maximum error.
        self._clock.set(start, (requested_at + answered_at) // 2)
        if not self._is_reported:
            self._clock.begin(start)
        self._recording = _Recording(
            start=start,
            max_clock_error=_MAX_CLOCK_ERROR_NS + answered_at - requested_at,
            validator=RecordingValidator(statuses),
            # In a retry, the first gap because of another client ends the recording.
            gaps_left=1 if self._is_reported else MAX_GAPS,
            drained_at=start,
            interval=STATUS_INTERVAL_S,
        )
        self._no_recording_reason, self._record_at = "", float("inf")

    def _read_recording(self, recording: _Recording) -> _Steps[None]:
        """Request the statuses and then the transitions up to them, and report the transitions."""
        statuses = yield from self._request_statuses()
        was_reply_lost, recording.is_reply_lost = recording.is_reply_lost, True
        requested_at = self._clock.wall()
        try:
            batch = yield from self._request(Request.GET_TRANSITIONS, decode_transitions)
        except _UnavailableDataError as error:
            self._sample_only(statuses, str(error), self._clock.wall())
            return
        recording.is_reply_lost = False
        drained_at, recording.drained_at = recording.drained_at, requested_at
        if batch and recording.wall(batch[0]) < drained_at - recording.max_clock_error:
            # Offsets count from the start of the recording, which another client's `start` moves.
            reason = "another client began a recording of this robot, or its clock was set"
            self._leave_recording(statuses, reason, requested_at)
            return
        known = recording.validator.statuses
        checked = recording.validator.apply(statuses, batch)
        recording.adapt_interval(len(batch))
        is_new, recording.is_new = recording.is_new, False
        if checked.is_complete:
            self._count_complete_batch(recording, batch)
            gap = "short changes before this time were not seen in the samples" if is_new else ""
        elif was_reply_lost:
            gap = "a reply of the robot with its recorded transitions did not arrive"
        elif checked.is_overflow:
            gap = (
                f"more than {MAX_RECORDED} statuses changed between two requests, and the robot keeps "
                "only the last ones"
            )
        else:
            gap = "another client reads this robot's recording too"
            recording.gaps_left -= 1
            recording.complete_batches = 0
            if not recording.gaps_left:
                self._leave_recording(recording.validator.statuses, gap, requested_at)
                return
        if gap:
            # The time of the first transition: statuses that changed in a gap are shown just before it.
            wall = recording.wall(batch[0]) if batch else requested_at
            if is_new and not checked.is_overflow:
                wall = recording.start
            self._report_gap(gap, wall)
            self._report_tree(wall, checked.before)
        else:
            for uid, record in checked.before.items():
                if record.status != known[uid].status:
                    self._report_transition(drained_at, uid, known[uid].status, record.status)
        for transition, previous in checked.steps:
            wall = recording.wall(transition)
            self._report_transition(wall, transition.uid, previous, transition.status)

    def _count_complete_batch(self, recording: _Recording, batch: list[RecordedTransition]) -> None:
        recording.complete_batches += bool(batch)
        if recording.complete_batches >= _FORGIVEN_AFTER_BATCHES:
            recording.gaps_left, recording.complete_batches = MAX_GAPS, 0
            self._retry_after = RETRY_AFTER_S

    def _leave_recording(self, statuses: dict[int, StatusRecord], reason: str, wall: int) -> None:
        """Leave the recording to another client, and continue with statuses only until the next retry."""
        retry_after, self._retry_after = self._retry_after, min(_MAX_RETRY_AFTER_S, 2 * self._retry_after)
        self._report_gap(f"{reason}: statuses are sampled for {retry_after:g} s", wall)
        self._sample_only(statuses, f"{reason}; next attempt to read it in {retry_after:g} s", wall)
        self._record_at = time.monotonic() + retry_after

    def _sample_only(self, statuses: dict[int, StatusRecord], reason: str, wall: int) -> None:
        """Continue with statuses only, because of *reason*."""
        self._recording = None
        self._record_at = float("inf")
        self._no_recording_reason = reason
        self._statuses = statuses
        self._report_tree(wall, statuses)

    # Events

    def _report_tree(self, wall: int, records: Mapping[int, StatusRecord]) -> None:
        statuses = {node.uid: 0 for node in self.tree.nodes}
        statuses |= {uid: record.status for uid, record in records.items()}
        self._is_reported = True
        self._reported_up_to = max(self._reported_up_to, self._clock.stamp(wall))
        results = {
            uid: record.previous for uid, record in records.items() if record.status == 0 and record.previous
        }
        self._events.append(
            TreeEvent(self.tree, self._reported_up_to, wall, statuses, False, self._create_source(), results)
        )

    def _create_source(self) -> DataSource:
        rate = self._blackboard_rate
        polled = f"requested {rate:g} times a second: short changes are not seen"
        unavailable: dict[DataKind, str] = {
            "ticks": NOT_SENT,
            "exceptions": NOT_SENT,
            "blackboard": polled if rate else "not requested",
        }
        if self._recording is not None:
            return DataSource("Groot 2, recorded", unavailable)
        reason = f" ({self._no_recording_reason})" if self._no_recording_reason else ""
        unavailable["transitions"] = (
            f"statuses are requested {1 / STATUS_INTERVAL_S:g} times a second{reason}: "
            "short changes are not seen"
        )
        return DataSource("Groot 2, sampled", unavailable)

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

    def _report_gap(self, reason: str, wall: int) -> None:
        """Report that transitions before *wall* (ns, robot's clock) are missing."""
        if self._is_reported:
            stamp = max(self._reported_up_to, self._clock.stamp(wall))
            self._events.append(MissingDataEvent(stamp, wall, self._reported_up_to, "transitions", reason))
