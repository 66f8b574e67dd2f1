"""Random schedules of goals on ROS 2 servers in another process: no wrong outcome, no hang.

``python tests/acceptance/ros2_schedules.py --schedules 500`` prints the counts, and exits with 1 on any miss.

A schedule has one or two clients. A client sends a goal whose number determines what the server does: accept
(at once or late), reject, send feedback, succeed, abort, be cancelled by a third client, never end, or die.
The client waits for the result, halts at an event or at a random time, or ends the goal at a feedback.
"""

import argparse
import logging
import random
import statistics
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Any

from planned_server import Answer, Cancel, End, Plan, ServerProcess

import btcore
from btcore import In, Registry, Status, Tree
from btcore_ros2.direct_take import action_clients
from btcore_ros2.leaves import ActionErrorCode as Code
from btcore_ros2.leaves import RosAction
from btcore_ros2.session import RosSession
from btcore_ros2.testing import isolate_ros

HANG_S = 90.0
PERIOD_NS = 10_000_000
PATIENT_MS, IMPATIENT_MS = 20_000, 100
HALTED = "halted"
TREE = """<root BTCPP_format="4"> <BehaviorTree ID="T">
  <Send name="{}" action_name="{}" order="{}"/> </BehaviorTree> </root>"""


class Stop(Enum):
    """When a client ends its goal."""

    NEVER = auto()
    ON_GOAL = auto()  # halt when the server has received the goal, but not answered
    ON_EXECUTION = auto()
    AT_RANDOM = auto()
    ON_FEEDBACK = auto()  # on_feedback returns SUCCESS


class Send(RosAction):
    """Send a goal, and remember what happened."""

    action_type = "test_msgs/action/Fibonacci"
    wait_for_server_timeout = 20_000
    order: In[int]
    stops = False
    code: Code | None = None

    def make_goal(self) -> Any:
        self.feedbacks: list[int] = []
        return self.action_type.Goal(order=self.order)

    def on_feedback(self, feedback: Any) -> Any:
        self.feedbacks += feedback.sequence
        return Status.SUCCESS if self.stops else Status.RUNNING

    def on_failure(self, error: Code) -> Any:
        self.code = error
        return False


@dataclass
class Client:
    """One goal of a schedule: what is planned, what may happen, and what happened."""

    plan: Plan
    stop: Stop
    halt_after_ms: int
    timeout_ms: int
    second_session: bool
    outcome: Any = None
    tree: Tree = field(init=False)
    leaf: Send = field(init=False)
    began: float = 0.0

    @property
    def allowed(self) -> set[Any]:
        """The outcomes that are correct: SUCCESS, an error code, or HALTED."""
        plan = self.plan
        if self.stop in (Stop.ON_GOAL, Stop.ON_EXECUTION):
            return {HALTED}
        natural: Any = Status.SUCCESS
        if plan.answer == Answer.DIE or self.timeout_ms == IMPATIENT_MS:
            natural = Code.SEND_GOAL_TIMEOUT
        elif plan.answer == Answer.REJECT:
            natural = Code.GOAL_REJECTED_BY_SERVER
        elif self.stop is Stop.ON_FEEDBACK:
            return {Status.SUCCESS}
        elif plan.end == End.ABORT:
            natural = Code.ACTION_ABORTED
        elif plan.end == End.CANCEL:
            natural = Status.SUCCESS if plan.cancel == Cancel.SUCCEED else Code.ACTION_CANCELLED
        elif plan.end == End.DIE:
            natural = Code.SERVER_UNREACHABLE
        return {natural, HALTED} if self.stop is Stop.AT_RANDOM else {natural}

    @property
    def must_be_canceled(self) -> bool:
        """Whether the server must report that the goal was cancelled: nothing else ends it."""
        return (
            self.plan.answer == Answer.ACCEPT
            and self.plan.end == End.NEVER
            and self.outcome is not Code.SERVER_UNREACHABLE
        )


def draw(rng: random.Random, tag: int) -> Client:
    """Return a random client for the goal *tag*."""
    stop = rng.choice(
        [Stop.NEVER, Stop.NEVER, Stop.AT_RANDOM, Stop.ON_EXECUTION, Stop.ON_GOAL, Stop.ON_FEEDBACK]
    )
    answer = Answer.ACCEPT
    end = rng.choice([End.SUCCEED, End.SUCCEED, End.ABORT, End.CANCEL])
    cancel = rng.choice(list(Cancel)) if end in (End.SUCCEED, End.ABORT) else Cancel.ACCEPT
    answer_slots = rng.choice([0, 0, 0, rng.randrange(1, 20)])
    work_slots = rng.randrange(0, 20)
    feedback = rng.randrange(0, 4)
    timeout_ms = PATIENT_MS
    if stop is Stop.NEVER:
        kind = rng.random()
        if kind < 0.15:
            answer = Answer.REJECT
        elif kind < 0.3:  # the answer arrives after the time-out
            timeout_ms, answer_slots, end = IMPATIENT_MS, rng.randrange(25, 40), rng.choice([End.NEVER, end])
        elif kind < 0.36:
            end = End.DIE
        elif kind < 0.4:
            answer, timeout_ms = Answer.DIE, IMPATIENT_MS
        if end == End.CANCEL:
            cancel = rng.choice([Cancel.ACCEPT, Cancel.ACCEPT_LATE, Cancel.SUCCEED])
    elif stop is Stop.ON_GOAL:
        answer_slots = rng.randrange(10, 25)
        answer = rng.choice([Answer.ACCEPT, Answer.ACCEPT, Answer.REJECT])
        end = rng.choice([End.NEVER, end])
    elif stop is Stop.ON_EXECUTION:
        end = End.NEVER
    elif stop is Stop.ON_FEEDBACK:
        feedback, work_slots, end = rng.randrange(1, 4), rng.randrange(8, 20), rng.choice([End.NEVER, end])
    if end == End.NEVER:
        cancel = rng.choice([Cancel.ACCEPT, Cancel.ACCEPT_LATE])
    plan = Plan(answer, answer_slots, end, work_slots, feedback, cancel, tag)
    return Client(plan, stop, rng.randrange(0, 600), timeout_ms, rng.random() < 0.3)


class Reports(logging.Handler):
    """Counts the reports of cancellations, by the name of the leaf."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: Counter[str] = Counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Count a report."""
        self.counts[str(record.args[0] if isinstance(record.args, tuple) else "")] += 1


class Run:
    """A run of many schedules."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.sessions = [RosSession("first"), RosSession("second")]
        self.nodes = Registry.standard()
        self.nodes.add(Send)
        self.connected: list[Tree] = []  # whose clients stay, because these trees use them
        self.lives = 0
        self.number = 0
        self.server: ServerProcess
        self.outcomes: Counter[str] = Counter()
        self.halts_us: list[float] = []
        self.lost_feedback = 0
        self.lost_goals = 0
        self.wrong: list[str] = []
        self.hangs: list[str] = []
        self.reports = Reports()
        self.log = logging.getLogger("btcore_ros2.leaves.goal")
        self.log.setLevel(logging.INFO)
        self.log.addHandler(self.reports)
        self.log.propagate = False
        self.start_server()

    def start_server(self) -> None:
        """Start a server with a new name: a dead server is visible for 20 s."""
        self.lives += 1
        self.namespace = f"/life{self.lives}"
        self.server = ServerProcess(self.namespace)
        self.connected.clear()
        for session in self.sessions:
            self.connect(session)

    def connect(self, session: RosSession) -> None:
        """Send goals until one succeeds: ROS 2 drops answers to a client that it has not discovered yet."""
        text = TREE.format("connect", f"{self.namespace}/planned", Plan().order)
        tree = btcore.loads(text, nodes=self.nodes, resources=[session], clock=session.clock)
        while tree.tick_while_running(period=0.01) is not Status.SUCCESS:
            self.lost_goals += 1
            assert self.lost_goals < 100, "the server does not answer"
        self.connected.append(tree)

    def close(self) -> None:
        """End the server and the clients."""
        self.server.kill()
        for session in self.sessions:
            session.close()
        self.log.removeHandler(self.reports)
        self.log.setLevel(logging.NOTSET)
        self.log.propagate = True

    def wait(self, condition: Callable[[], Any], seconds: float = HANG_S) -> bool:
        """Take messages until *condition* is met."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            for session in self.sessions:
                session.clock.wait_until(session.clock.now() + PERIOD_NS // 2, threading.Event())
        return True

    def schedule(self) -> None:
        """Run one schedule, and check it."""
        clients = [self.start_client() for _ in range(self.rng.choice([1, 1, 2]))]
        restart = self.rng.random() < 0.9
        life = self.server.process
        done = self.wait(lambda: self.tick(clients, restart))
        if any(client.plan.answer == Answer.DIE for client in clients):  # perhaps after the time-out
            self.wait(lambda: life.poll() is not None)
        died = life.poll() is not None
        for client in clients:
            self.check(client, done, died and len(clients) > 1)
        if not died:
            for client in clients:
                self.check_server(client)
        clean = self.wait(lambda: not any(session.unfinished for session in self.sessions), HANG_S)
        if not clean and not died:
            self.hangs.append(f"{self.number}: a cancellation is not finished: {clients}")
        if died:
            self.server.kill()
            self.start_server()
        self.number += 1

    def check_clients(self) -> None:
        """Check that the action clients keep nothing of the goals."""
        clients = [client for session in self.sessions for client, _, _ in action_clients(session.node)]
        if not self.wait(
            lambda: not any(client._futures or client._feedback_callbacks for client in clients)
        ):
            self.wrong.append("an action client keeps something of goals that have ended")

    def start_client(self) -> Client:
        """Draw a client and load its tree."""
        tag = 1 + self.number * 2 % 510 + self.rng.randrange(2)
        while self.server.of(tag):
            tag = tag % 511 + 1
        client = draw(self.rng, tag)
        self.server.events.append((tag, "planned"))
        session = self.sessions[client.second_session]
        text = TREE.format(f"goal{self.number}_{tag}", f"{self.namespace}/planned", client.plan.order)
        client.tree = btcore.loads(text, nodes=self.nodes, resources=[session], clock=session.clock)
        client.leaf = next(node for node in client.tree if isinstance(node, Send))
        client.leaf.server_timeout = client.timeout_ms
        client.leaf.stops = client.stop is Stop.ON_FEEDBACK
        client.began = time.monotonic()
        return client

    def tick(self, clients: list[Client], restart: bool) -> bool:
        """Tick or halt each client. Return whether all have an outcome."""
        for client in clients:
            if client.outcome is None:
                if self.must_halt(client):
                    began = time.thread_time()
                    client.tree.halt()
                    self.halts_us.append((time.thread_time() - began) * 1e6)
                    client.outcome = HALTED
                    continue
                status = client.tree.tick_once()
                if status is not Status.RUNNING:
                    client.outcome = client.leaf.code or status
        # A server that died during a goal is started again with the same name, as a launch file does.
        dead = self.server.process.poll() is not None
        if dead and restart and any(client.outcome is None for client in clients):
            self.server.start()
        return all(client.outcome is not None for client in clients)

    def must_halt(self, client: Client) -> bool:
        """Return whether the time of the client's halt has come."""
        events = self.server.of(client.plan.tag)
        if client.stop is Stop.ON_GOAL:
            return "goal" in events
        if client.stop is Stop.ON_EXECUTION:
            return "executing" in events
        return client.stop is Stop.AT_RANDOM and time.monotonic() > client.began + client.halt_after_ms / 1000

    def check(self, client: Client, done: bool, shares_death: bool) -> None:
        """Compare the outcome of a client with the allowed outcomes."""
        name = str(getattr(client.outcome, "name", client.outcome))
        self.outcomes[name] += 1
        if not done and client.outcome is None:
            self.hangs.append(f"{self.number}: no outcome: {client}")
            client.tree.halt()
            return
        allowed = client.allowed
        if shares_death:  # the goal of the other client ended the server
            allowed = allowed | {Code.SERVER_UNREACHABLE, Code.SEND_GOAL_TIMEOUT}
        if client.outcome not in allowed:
            self.wrong.append(f"{self.number}: {name} instead of {allowed}: {client}")
        feedbacks = client.leaf.feedbacks
        if feedbacks != sorted(set(feedbacks)):
            self.wrong.append(f"{self.number}: feedback in a wrong order: {feedbacks}: {client}")
        if client.outcome is Status.SUCCESS and client.stop is not Stop.ON_FEEDBACK:
            if list(client.leaf.last_result.sequence) != [client.plan.tag]:
                self.wrong.append(f"{self.number}: the result of another goal: {client}")
            self.lost_feedback += client.plan.feedback - len(feedbacks)

    def check_server(self, client: Client) -> None:
        """Check that the goal does not run on, and that its cancellation was reported once."""
        if client.must_be_canceled and not self.wait(
            lambda: "canceled" in self.server.of(client.plan.tag) or self.server.process.poll() is not None
        ):
            self.wrong.append(f"{self.number}: the goal still runs on the server: {client}")
        path = client.leaf.path
        if client.must_be_canceled:
            self.wait(lambda: self.reports.counts[path])
        count = self.reports.counts[path]
        if count > 1 or (client.must_be_canceled and count != 1):
            self.wrong.append(f"{self.number}: {count} reports of the cancellation: {client}")


def main() -> int:
    """Run the schedules, print the counts, and return 1 on a wrong outcome or a hang, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--schedules", type=int, default=500, help="how many (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the random numbers (default: %(default)s)")
    options = parser.parse_args()
    isolate_ros()
    logging.getLogger("btcore_ros2.leaves.action").setLevel(logging.ERROR)
    run = Run(options.seed)
    began = time.monotonic()
    try:
        for number in range(options.schedules):
            run.schedule()
            if number % 50 == 49:
                print(f"{number + 1} schedules, {time.monotonic() - began:.0f} s", flush=True)
        run.check_clients()
    finally:
        run.close()
    for name, count in run.outcomes.most_common():
        print(f"{count:5} {name}")
    if run.halts_us:
        middle, most = statistics.median(run.halts_us), max(run.halts_us)
        print(f"{len(run.halts_us)} halts of {middle:.0f} µs in the median, at most {most:.0f} µs (CPU time)")
    print(f"{run.lives} server processes; {run.lost_goals} first goals were not answered")
    print(f"{run.lost_feedback} feedbacks arrived after the result")
    for miss in run.wrong + run.hangs:
        print(f"miss: {miss}")
    print(f"{options.schedules} schedules: {len(run.wrong)} wrong outcomes, {len(run.hangs)} hangs")
    return 1 if run.wrong or run.hangs else 0


if __name__ == "__main__":
    raise SystemExit(main())
