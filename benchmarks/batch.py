"""The batch engine compared with the ordinary engine, in ratios of processor time.

    python benchmarks/batch.py [--pairs 9] [--agents 100 1000 10000 100000] [--quick] [--json]

The tree controls a robot that recharges its battery. It has 20 nodes, among them 8 leaves with ports, two
scripts and a subtree. The leaves compute the same in both engines: with numbers in the ordinary engine, with
arrays in the batch. The agents start with different battery levels, so that every tick executes different
nodes for different agents.

The ordinary engine ticks a tree for each agent, but at most 1,000 trees; the time for more agents is
extrapolated, because the trees are independent. A thousand trees do not fit into the processor's caches, so
the ratio for ten trees (extrapolated likewise) is reported too. The engines run in pairs, and the order
alternates from pair to pair. The figures are medians over the pairs, with quartiles.
"""

import gc
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

import btcore
import btcore_batch as batch
from btcore import In, Put, Registry, SimClock, action, condition
from btcore.clock import NS_PER_US
from btcore_batch import BatchTree, Bools, Floats
from measure.paired_timing import Work, measure_rounds
from measure.report import Report, at_least, create_parser

MAX_TREES = 1_000
CACHED_TREES = 10
"""A number of trees that fit into the processor's caches."""
TICKS = 20
THROUGHPUT = at_least(compiled=20, pure=20)
TARGET_AGENTS = 1_000
"""The smallest number of agents to which the target applies."""

DOCUMENT = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <ReactiveFallback>
      <Sequence>
        <Inverter> <BatteryOk level="{battery}"/> </Inverter>
        <SubTree ID="Charge" battery="{battery}" place="{place}"/>
      </Sequence>
      <Sequence>
        <Fallback>
          <Near place="{place}" goal="{goal}"/>
          <Drive place="{place}" goal="{goal}" battery="{battery}" at="{place}" left="{battery}"/>
        </Fallback>
        <Near place="{place}" goal="{goal}"/>
        <Script code="goal := goal > 0 ? -10.0 : 10.0"/>
      </Sequence>
    </ReactiveFallback>
  </BehaviorTree>
  <BehaviorTree ID="Charge">
    <Sequence>
      <RetryUntilSuccessful num_attempts="-1">
        <Sequence>
          <Drive place="{place}" goal="0.0" battery="{battery}" at="{place}" left="{battery}"/>
          <Near place="{place}" goal="0.0"/>
        </Sequence>
      </RetryUntilSuccessful>
      <RetryUntilSuccessful num_attempts="-1">
        <Sequence>
          <Load battery="{battery}" more="{battery}"/>
          <ScriptCondition code="battery &gt;= 0.9"/>
        </Sequence>
      </RetryUntilSuccessful>
    </Sequence>
  </BehaviorTree>
</root>
"""


@condition
def battery_ok(level: In[float]) -> bool:
    return level > 0.2


@condition
def near(place: In[float], goal: In[float]) -> bool:
    return abs(place - goal) < 0.5


@action
def drive(place: In[float], goal: In[float], battery: In[float], at: Put[float], left: Put[float]) -> bool:
    at(place + max(-0.4, min(0.4, goal - place)))
    left(max(battery - 0.01, 0.0))
    return True


@action
def load(battery: In[float], more: Put[float]) -> bool:
    more(battery + 0.05)
    return True


@batch.condition(ID="BatteryOk")
def battery_ok_of_all(level: In[Floats]) -> Bools:
    return level > 0.2


@batch.condition(ID="Near")
def near_of_all(place: In[Floats], goal: In[Floats]) -> Bools:
    return np.abs(place - goal) < 0.5


@batch.action(ID="Drive")
def drive_all(
    place: In[Floats], goal: In[Floats], battery: In[Floats], at: Put[Floats], left: Put[Floats]
) -> bool:
    at(place + np.maximum(-0.4, np.minimum(0.4, goal - place)))
    left(np.maximum(battery - 0.01, 0.0))
    return True


@batch.action(ID="Load")
def load_all(battery: In[Floats], more: Put[Floats]) -> bool:
    more(battery + 0.05)
    return True


LEAVES = [battery_ok_of_all, near_of_all, drive_all, load_all]


def initial_values(agents: int) -> list[dict[str, float]]:
    """Return the blackboard entries with which each agent starts."""
    drawn = random.Random(1)
    return [
        {"battery": drawn.random(), "place": drawn.uniform(-9.0, 9.0), "goal": drawn.choice([-10.0, 10.0])}
        for _ in range(agents)
    ]


def create_trees(agents: list[dict[str, float]]) -> list[btcore.Tree]:
    """Return a tree for each agent, with its initial values."""
    nodes = Registry.standard()
    nodes.add(battery_ok, near, drive, load)
    trees = []
    for values in agents:
        tree = btcore.loads(DOCUMENT, nodes=nodes, clock=SimClock())
        for key, value in values.items():
            tree.blackboard[key] = value
        trees.append(tree)
    return trees


def create_batch(agents: list[dict[str, float]]) -> BatchTree:
    """Return a batch for all agents, with their initial values."""
    columns = {key: np.array([values[key] for values in agents]) for key in agents[0]}
    return BatchTree.loads(DOCUMENT, len(agents), LEAVES, blackboard=columns, clock=SimClock())


def check_same_results(agents: int) -> None:
    """Assert that both engines return the same statuses and write the same battery levels."""
    values = initial_values(agents)
    trees, swarm = create_trees(values), create_batch(values)
    for _ in range(100):
        expected = [int(tree.tick_exactly_once()) for tree in trees]
        assert swarm.tick().tolist() == expected
        assert swarm.blackboard["battery"].tolist() == [tree.blackboard["battery"] for tree in trees]


def tick_all(ticks: Sequence[Callable[[], object]]) -> None:
    """Call each of *ticks* TICKS times."""
    for _ in range(TICKS):
        for tick in ticks:
            tick()


def rounds(trees: Sequence[btcore.Tree], swarm: BatchTree, count: int) -> Iterator[Mapping[str, Work]]:
    """Yield *count* rounds after a round for the warm-up; the order of the engines alternates."""
    ticks = [tree.tick_exactly_once for tree in trees]
    ordinary, batch = partial(tick_all, ticks), partial(tick_all, [swarm.tick])
    cached = partial(tick_all, ticks[:CACHED_TREES])
    for index in range(count + 1):
        gc.collect()  # so that no engine collects the garbage of the other engine
        if index % 2:
            yield {"batch": batch, "ordinary": ordinary, "cached": cached}
        else:
            yield {"ordinary": ordinary, "batch": batch, "cached": cached}


def compare(report: Report, agents: int) -> None:
    """Measure both engines with *agents* agents, and add a row to *report*."""
    values = initial_values(agents)
    trees, swarm = create_trees(values[:MAX_TREES]), create_batch(values)
    measured = measure_rounds(rounds(trees, swarm, report.pairs))
    cached = measured.ratio("cached", "batch").times(agents / CACHED_TREES)
    figures = {
        "a tick of all": f"{measured.time('batch').median / TICKS / NS_PER_US:,.0f} µs",
        f"{CACHED_TREES} trees / batch": f"{cached.median:.3g}",
    }
    ratio = measured.ratio("ordinary", "batch").times(agents / len(trees))
    target = THROUGHPUT if agents >= TARGET_AGENTS else None
    report.add(f"{agents:,} agents: ordinary / batch", ratio, target, figures)


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "")
    parser.add_argument("--agents", type=int, nargs="+", default=[100, 1_000, 10_000, 100_000])
    options = parser.parse_args()
    check_same_results(50)
    nodes = len(create_trees(initial_values(1))[0].nodes)
    question = f"How much faster a batch is than a tree of {nodes} nodes for each agent"
    report = Report("batch", question, options.pairs)
    for agents in [100] if options.quick else options.agents:
        compare(report, agents)
    report.output(options.json)


if __name__ == "__main__":
    main()
