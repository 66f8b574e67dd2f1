"""Thousands of goals for `btcore ros2 serve`, with leaves on 200 names of topics: nothing piles up.

``python tests/acceptance/ros2_goals.py --goals 10000`` sends the goals to a tree server in another process.
Its trees use an action, a service and topics. A leaf of a plugin counts the threads, ROS entities and objects
of the server after a warm-up, and after the goals. The script prints both, and exits with 1 if something has
grown, a goal has failed, or a corrected `type` in the file does not work at the next goal.
"""

import argparse
import json
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import Any

from checkout import environment
from planned_server import Plan, start_planned_server

from btcore_ros2.session import RosSession
from btcore_ros2.testing import isolate_ros

NAMES = 200
WARM_UP = 2 * NAMES
LIMIT_S = 120.0
IN_PROGRESS = 5
"""How many goals are sent before the first has ended; the queue of a service in ROS 2 has 10 places."""

EXPIRY_S = 25.0
"""The time (s) after which rclpy and the server have forgotten all goals: 10 s to 20 s after their end."""

MAX_GROWTH, MAX_GROWTH_KB = 300, 8_000
"""How many Python objects, and how much memory (kB), more than before count as nothing."""

TREES = """
<root BTCPP_format="4">
  <BehaviorTree ID="Act">
    <RosActionCall action_name="/planned" type="test_msgs/action/Fibonacci" server_timeout="60000"
                   wait_for_server_timeout="60000" goal='json:{{"order": {order}}}' result="{{result}}"/>
  </BehaviorTree>
  <BehaviorTree ID="Call">
    <RosServiceCall service_name="/planned_service" type="test_msgs/srv/BasicTypes" server_timeout="60000"
                    wait_for_server_timeout="60000" request='json:{{"int32_value": 1}}'
                    response="{{answer}}"/>
  </BehaviorTree>
  <BehaviorTree ID="Talk">
    <Sequence>
      <RosTopicPublish topic_name="{{topic}}" type="std_msgs/msg/{kind}" message='json:{{}}'
                       wait_for_subscriber_timeout="0"/>
      <ForceSuccess>
        <RosTopicRead topic_name="{{other}}" type="std_msgs/msg/{kind}" timeout="0"/>
      </ForceSuccess>
      <RosTransformPublish child="{{topic}}" pose=""/>
      <ForceSuccess><RosTransformRead child="{{other}}" timeout="0"/></ForceSuccess>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="All">
    <Sequence><SubTree ID="Act"/><SubTree ID="Call"/><SubTree ID="Talk" _autoremap="true"/></Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Count">
    <Sequence>
      <Sleep msec="500" name="the monitor shows this tree instead of the last"/>
      <CountObjects file="{{file}}"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
KINDS = ("Act", "Call", "Talk", "All")

PLUGIN = '''
import collections, gc, json, os, pathlib, threading

import btcore
from btcore_ros2.session import RosSession

COUNTED = {
    "ActionClient", "Client", "Publisher", "Subscription", "Future", "Task", "ServerGoalHandle", "ServerGoal",
    "ClientGoalHandle", "ClientGoal", "SharedEntity", "_Newest", "_Topic", "Tree", "Blackboard",
}

@btcore.action
def count_objects(session: RosSession, file: btcore.In[str]):
    """Write what this process has to a file."""
    gc.collect()
    node = session.node
    types = collections.Counter(type(found).__name__ for found in gc.get_objects())
    status = pathlib.Path("/proc/self/status").read_text()
    field = lambda name: int(status.split(f"{name}:")[1].split()[0])
    counts = {
        "threads": field("Threads"),
        "open files": len(os.listdir("/proc/self/fd")),
        **{f"node.{part}": len(list(getattr(node, part)))
           for part in ("publishers", "subscriptions", "clients", "services", "timers", "waitables")},
        "futures of waitables": sum(len(waitable._futures) for waitable in node.waitables),
        "entities of the callback group": sum(
            reference() is not None for reference in node.default_callback_group.entities
        ),
        "tasks": len(session._executor._tasks),
        "callbacks after drain": len(session._after_drain),
        "unfinished": len(session.unfinished),
        "shared entities": len(session.entities._entities),
        "reports": len(session.reports),
        **{f"objects {name}": types[name] for name in sorted(COUNTED)},
        "objects": sum(types.values()) - types["tuple"],  # the collector forgets some tuples
        "memory (kB)": field("VmRSS"),
    }
    pathlib.Path(file + ".part").write_text(json.dumps(counts))
    os.replace(file + ".part", file)
    return True
'''


class GoalRun:
    """A tree server in another process, the servers that its trees use, and a client.

    Args:
        folder: A folder for the files.
    """

    def __init__(self, folder: Path) -> None:
        from btcpp_ros2_interfaces.action import ExecuteTree
        from btcpp_ros2_interfaces.srv import GetTrees
        from rclpy.action import ActionClient

        self.failed: list[str] = []
        self.sent = 0
        self._goal_type = ExecuteTree.Goal
        self._folder = folder
        self._trees = folder / "trees.xml"
        self._peer = start_planned_server()
        self._peer.__enter__()
        self.write_trees("String")
        (folder / "plugin.py").write_text(PLUGIN)
        command = [sys.executable, "-m", "btcore", "ros2", "serve", str(self._trees)]
        command += ["--plugin", str(folder / "plugin.py"), "--tick-frequency", "1000", "--port", "0"]
        self.server = Popen(command, stderr=DEVNULL, env=environment())
        self._session = RosSession("client")
        self._client = ActionClient(self._session.node, ExecuteTree, "bt_execution")
        last = self._session.node.create_client(GetTrees, "get_loaded_trees")
        self._wait(lambda: self._client.server_is_ready() and last.service_is_ready())
        # A server cannot answer clients that it does not know. It finds those of a process in order.
        self._wait(lambda: self._session.wait_for(last.call_async(GetTrees.Request()).done, 1.0))

    def write_trees(self, kind: str) -> None:
        """Write the file of the trees, whose topics have the type std_msgs/*kind*."""
        order = Plan(work_slots=0).order
        self._trees.write_text(TREES.format(order=order, kind=kind))

    def send(self, count: int) -> None:
        """Send *count* goals of all kinds, a few at a time, and wait for their ends."""
        pending: list[Any] = []
        for _ in range(count):
            number = self.sent
            self.sent += 1
            topics = {"topic": f"/topic{number % NAMES}", "other": f"/topic{(7 * number + 1) % NAMES}"}
            pending.append(self._start(KINDS[number % 7 % len(KINDS)], topics))
            if len(pending) >= IN_PROGRESS:
                self._end(*pending.pop(0))
        for goal in pending:
            self._end(*goal)

    def execute(self, tree: str, payload: dict[str, str]) -> None:
        """Send a goal, and wait for its end."""
        self._end(*self._start(tree, payload))

    def resting_counts(self, seconds: float) -> dict[str, int]:
        """Return what an idle server has, *seconds* after the last goal."""
        self.counts()  # takes the place of the last tree, whose entities end
        self.rest(seconds)
        return self.counts()

    def counts(self) -> dict[str, int]:
        """Return what the server has at present."""
        file = self._folder / "counts.json"
        self.execute("Count", {"file": str(file)})
        counts: dict[str, int] = json.loads(file.read_text())
        return counts

    def rest(self, seconds: float) -> None:
        """Let the server be idle."""
        clock = self._session.clock
        clock.wait_until(clock.now() + round(seconds * 1e9), threading.Event())

    def close(self) -> None:
        """End all processes."""
        self.server.send_signal(signal.SIGINT)
        self.server.wait(LIMIT_S)
        self._session.close()
        self._peer.__exit__(None, None, None)

    def _start(self, tree: str, payload: dict[str, str]) -> tuple[str, Any]:
        goal = self._goal_type(target_tree=tree, payload=f"json:{json.dumps(payload)}")
        return tree, self._client.send_goal_async(goal)

    def _end(self, tree: str, accepted: Any) -> None:
        self._wait(accepted.done)
        result = accepted.result().get_result_async()
        self._wait(result.done)
        message = result.result().result.return_message
        if message != "the tree ended in SUCCESS":
            self.failed.append(f"{tree}: {message}")

    def _wait(self, condition: Callable[[], Any]) -> None:
        assert self._session.wait_for(condition, LIMIT_S), "the tree server does not answer"
        assert self.server.poll() is None, "the tree server has ended"


def grown(before: dict[str, int], after: dict[str, int]) -> list[str]:
    """Return what is more in *after* than in *before*."""
    tolerances = {"objects": MAX_GROWTH, "memory (kB)": MAX_GROWTH_KB}
    return [
        f"{name}: {count} → {after[name]}"
        for name, count in before.items()
        if after[name] > count + tolerances.get(name, 0)
    ]


def main() -> int:
    """Send the goals, print the figures, and return 1 on any miss, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--goals", type=int, default=10_000, metavar="N")
    options = parser.parse_args()
    isolate_ros()
    with tempfile.TemporaryDirectory() as folder:
        run = GoalRun(Path(folder))
        try:
            run.send(WARM_UP)
            before, began = run.resting_counts(EXPIRY_S), time.monotonic()
            for _ in range(10):
                run.send(options.goals // 10)
                print(f"{run.sent:6} goals  {run.counts()['memory (kB)']} kB", flush=True)
            seconds = time.monotonic() - began
            after = run.resting_counts(EXPIRY_S)
            run.write_trees("Bool")
            run.execute("Talk", {"topic": "/topic0", "other": "/topic0"})
        finally:
            run.close()
    for name, count in before.items():
        print(f"{name:34} {count:8} {after[name]:8}")
    missed = grown(before, after) + run.failed
    for miss in missed[:20]:
        print(f"miss: {miss}")
    print(f"{run.sent} goals, {seconds:.0f} s for {options.goals}: {len(missed)} misses")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
