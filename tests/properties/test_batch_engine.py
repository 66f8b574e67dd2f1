"""The batch engine does for many agents what the ordinary engine does for a single agent."""

from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import event, example, given
from hypothesis import strategies as st

import btcore
from btcore import Blackboard, NodeExecutionError, Registry, SimClock
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.registry.outcome_grammar import LETTERS, Start
from btcore.testing import Outcomes, outcomes, xml_documents
from btcore.testing.tree_generator import SCRIPT_KEYS, cached_integers, cached_sampled_from
from tests.conformance.recorded_cases import CallLog, conformance_registry

np = pytest.importorskip("numpy")
import btcore_batch as batch  # noqa: E402
from btcore_batch import BatchNodeError, BatchTree  # noqa: E402
from btcore_batch.node_classes import BATCH_CLASSES  # noqa: E402

Call = tuple[int, str, str]
PERIOD = 0.01


def runs_in_batch(xml: str) -> bool:
    """Return whether the batch engine supports every built-in node of *xml*."""
    refused = [id for id, cls in BUILTIN_NODES[4].items() if cls not in BATCH_CLASSES]
    return not any(f"<{id} " in xml for id in refused)


NODES = conformance_registry()


class SingleTree:
    """An ordinary tree for one agent."""

    def __init__(self, xml: str, plan: Outcomes, values: Sequence[Any], clock: SimClock) -> None:
        self.calls = CallLog()
        board = Blackboard(clock=clock)
        for key, value in zip(SCRIPT_KEYS, values, strict=False):
            board[key] = value
        self.tree = btcore.loads(xml, nodes=NODES, resources=[self.calls], blackboard=board, clock=clock)
        plan.attach(self.tree)

    def tick(self) -> tuple[int, bool]:
        try:
            return int(self.tree.tick_exactly_once()), False
        except NodeExecutionError:
            return 0, True

    def halt(self) -> bool:
        """Halt the tree, and return whether a node raised."""
        try:
            self.tree.halt()
        except NodeExecutionError:
            return True
        return False

    def boards(self) -> dict[str, dict[str, object]]:
        return {
            subtree.path: {key: entry.value for key, entry in subtree.blackboard.local_entries().items()}
            for subtree in self.tree.subtrees
        }


class AgentPlans:
    """The plans and the leaf calls of all agents."""

    def __init__(self, plans: Sequence[Outcomes]) -> None:
        self.plans = plans
        self.calls = [CallLog() for _ in plans]


class ActForAll(batch.StatefulAction):
    """The same action for all agents at once."""

    def __init__(self, plans: AgentPlans) -> None:
        self.plans = plans
        self.left: list[Start] = [()] * self.agents

    def on_start(self, mask: batch.Mask) -> object:
        for at in np.flatnonzero(mask):
            self.left[at] = self.plans.plans[at].next_start()
        return self._letters(mask, "start")

    def on_running(self, mask: batch.Mask) -> object:
        return self._letters(mask, "running")

    def on_halted(self, mask: batch.Mask) -> None:
        for at in np.flatnonzero(mask):
            self.plans.calls[at].record(self.name, "halted")

    def _letters(self, mask: batch.Mask, what: str) -> object:
        found = np.full(self.agents, 77, dtype=np.uint8)
        for at in np.flatnonzero(mask):
            self.plans.calls[at].record(self.name, what)
            left = self.left[at]
            # 0 stands for an exception.
            found[at] = LETTERS.get(left[0].letter, 0)
            self.left[at] = left[1:] or left
        return found


@batch.condition(ID="Ask")
def ask_for_all(mask: batch.Mask, plans: AgentPlans) -> object:
    found = np.full(len(mask), 77, dtype=np.uint8)
    for at in np.flatnonzero(mask):
        plans.calls[at].record("Ask", "tick")
        found[at] = LETTERS.get(plans.plans[at].next_start(is_condition=True)[0].letter, 0)
    return found


ActForAll.__name__ = "Act"


class AgentBatch:
    """A batch for all agents."""

    def __init__(
        self, xml: str, plans: Sequence[Outcomes], values: Sequence[Sequence[Any]], clock: SimClock
    ) -> None:
        self.plans = AgentPlans(plans)
        columns = {
            key: np.array([row[at] for row in values]) for at, key in enumerate(SCRIPT_KEYS) if values[0]
        }
        self.tree = BatchTree.loads(
            xml, len(plans), [ActForAll, ask_for_all], resources=[self.plans], blackboard=columns, clock=clock
        )


def ticked(tree: BatchTree, mask: Any = None) -> list[tuple[int, bool]]:
    """Tick *tree* and return each agent's status and whether a node raised for it."""
    raised: set[int] = set()
    try:
        found = tree.tick(mask)
    except BatchNodeError as error:
        found = error.statuses
        raised = agents_of(error)
    return [(int(status), at in raised) for at, status in enumerate(found)]


def halted(tree: BatchTree, mask: Any) -> set[int]:
    """Halt *tree* and return the agents for which a node raised."""
    try:
        tree.halt(mask)
    except BatchNodeError as error:
        return agents_of(error)
    return set()


def agents_of(error: BatchNodeError) -> set[int]:
    """Return the agents of *error* and of the errors that followed."""
    return {int(at) for failure in [error, *error.later_errors] for at in failure.agents}  # type: ignore[attr-defined]


def entries_of_agent(tree: BatchTree, at: int) -> dict[str, dict[str, object]]:
    """Return the entries of the blackboards of agent *at*."""
    found: dict[str, dict[str, object]] = {}
    for path, board in tree.blackboards.items():
        found[path] = {}
        for key, entry in board.scope.local_entries().items():
            column = board.columns.column_of(entry, key)
            if column.exists >> at & 1:
                found[path][key] = column.objects(1 << at)[at]
    return found


def compare(
    xml: str,
    plans: Sequence[Outcomes],
    values: Sequence[Sequence[Any]],
    masks: Sequence[int],
    halt: int,
    waits: float = PERIOD,
) -> None:
    """Tick the trees and the batch by *masks* (bit i is agent i; agent 0 is always ticked), and compare."""
    clock = SimClock()
    copies = [Outcomes(plan.shared) for plan in plans]
    singles = [SingleTree(xml, plan, given, clock) for plan, given in zip(plans, values, strict=True)]
    many = AgentBatch(xml, copies, values, clock)
    count = len(plans)
    for mask in [*masks, None]:
        if mask is None:
            chosen = np.array([bool(halt >> at & 1) for at in range(count)])
            raised = {int(at) for at in np.flatnonzero(chosen) if singles[at].halt()}
            assert halted(many.tree, chosen) == raised
        else:
            chosen = np.array([at == 0 or bool(mask >> at & 1) for at in range(count)])
            found = ticked(many.tree, None if chosen.all() else chosen)
            for at, single in enumerate(singles):
                assert found[at] == (single.tick() if chosen[at] else (0, False)), f"agent {at}"
        stored = np.array([node.status for node in many.tree])
        for at, single in enumerate(singles):
            assert [int(node.status) for node in single.tree] == stored[:, at].tolist(), f"agent {at}"
            assert comparable(single.calls) == comparable(many.plans.calls[at]), f"agent {at}"
            assert with_types(single.boards()) == with_types(entries_of_agent(many.tree, at)), f"agent {at}"
        clock.advance(waits)


def comparable(calls: CallLog) -> list[str]:
    return [call if not call.endswith(":tick") else "Ask:tick" for call in calls]


def with_types(boards: dict[str, dict[str, object]]) -> dict[str, dict[str, tuple[type, object]]]:
    return {
        path: {key: (type(value), value) for key, value in sorted(board.items())}
        for path, board in boards.items()
    }


@st.composite
def crowds(draw: st.DrawFn, skipped: bool = True, raising: bool = True) -> tuple[list[Outcomes], list[Any]]:
    """Draw plans and blackboards for some agents."""
    plans = draw(st.lists(outcomes(skipped=skipped, raising=raising), min_size=1, max_size=4))
    number = st.sampled_from([0, 1, 2, -1, 3])
    values = [tuple(draw(number) for _ in SCRIPT_KEYS) for _ in plans]
    return plans, values


HANDLER_THAT_RAISES = """<root BTCPP_format="4"><BehaviorTree ID="Main">
  <TryCatch catch_on_halt="true"><Act name="a"/><Ask name="b"/></TryCatch>
</BehaviorTree></root>"""


@given(
    xml_documents(own_outcomes=False, timed=True, subtrees=2, conditions=True, scripts=True).filter(
        runs_in_batch
    ),
    crowds(),
    st.lists(st.integers(0, 15), min_size=1, max_size=8),
    st.integers(0, 15),
)
@example(HANDLER_THAT_RAISES, ([Outcomes("S"), Outcomes("RX")], [(0, 0, 0), (0, 0, 0)]), [15], 2)
def test_batch_does_the_same_as_one_tree_per_agent(
    xml: str, crowd: tuple[list[Outcomes], list[Any]], masks: list[int], halt: int
) -> None:
    plans, values = crowd
    event(f"{len(plans)} agents")
    compare(xml, plans, values, [15, *masks], halt)


SCRIPTS = (
    "n := 1", "n := n + 1", "n += 0.5", "n *= 2", "n := m", "n -= m", "m := n", "x := n", "x := x + 1",
    "x := 1.5", "x := 2", "n := -n", "n := 1 / m", "n := n > 1 ? m : n", "x := n > 1", "n := !m", "x := ~m",
    "x := n == 1 || m == 2", "x := n &amp; 3", "t := 'walk'", "t := t + '!'", "t = 'run'", "n := '2'",
    "x := t", "x := n .. t", "@n := 7", "@x := @n", "n := (m := m + 1) + m", "n := m + (m := 1)", "y = 1",
    "n /= 3", "x := 1 &lt; n &lt; 3",
)  # fmt: skip
QUESTIONS = (
    "n", "n > m", "x == 1", "t == 'walk'", "t != 'run'", "n == t", "n &amp;&amp; m", "n || false", "!n",
    "n - 1", "0 &lt; n &lt;= m", "m == 1 ? n : m", "t", "y > 1", "t &lt; 'w'",
)  # fmt: skip
ENTRIES = st.sampled_from(["n", "m", "x", "t", "y"])
OTHERS = st.sampled_from(["1", "2", "-1", "0", "1.5", "walk", "run", "{n}", "{t}", "{x}"])


@btcore.condition
def take_int(port: btcore.In[int]) -> bool:
    return port > 1


@btcore.condition
def take_float(port: btcore.In[float]) -> bool:
    return port > 1.0


@btcore.condition
def take_bool(port: btcore.In[bool]) -> bool:
    return port


@btcore.condition
def take_text(port: btcore.In[str]) -> bool:
    return port == "walk"


@btcore.action
def give_int(port: btcore.In[int], out: btcore.Put[int]) -> bool:
    out(port + 1)
    return True


@btcore.action
def give_float(port: btcore.In[float], out: btcore.Put[float]) -> bool:
    out(port * 1.5)
    return True


@batch.condition(ID="TakeInt")
def take_ints(port: btcore.In[int]) -> object:
    return np.asarray(port) > 1


@batch.condition(ID="TakeFloat")
def take_floats(port: btcore.In[batch.Floats]) -> object:
    return port > 1.0


@batch.condition(ID="TakeBool")
def take_bools(port: btcore.In[batch.Bools]) -> object:
    return port.astype(bool)


@batch.condition(ID="TakeText")
def take_texts(port: btcore.In[str]) -> object:
    return (port == np.array("walk", dtype=object)).astype(bool)


@batch.action(ID="GiveInt")
def give_ints(port: btcore.In[int], out: btcore.Put[int]) -> bool:
    out(np.asarray(port) + 1)
    return True


@batch.action(ID="GiveFloat")
def give_floats(port: btcore.In[batch.Floats], out: btcore.Put[batch.Floats]) -> bool:
    out(port * 1.5)
    return True


@st.composite
def typed_documents(draw: st.DrawFn) -> str:
    """Draw trees whose nodes read and write entries of several types."""

    def leaf() -> str:
        kind = draw(cached_integers(0, 6))
        key, other = draw(ENTRIES), draw(ENTRIES)
        if kind <= 1:
            return f'<Script code="{draw(cached_sampled_from(SCRIPTS))}"/>'
        if kind == 2:
            return f'<ScriptCondition code="{draw(cached_sampled_from(QUESTIONS))}"/>'
        if kind == 3:
            return f'<SetBlackboard value="{draw(OTHERS)}" output_key="{key}"/>'
        if kind == 4:
            taker = draw(cached_sampled_from(("TakeInt", "TakeFloat", "TakeBool", "TakeText")))
            return f'<{taker} port="{{{key}}}"/>'
        if kind == 5:
            return (
                f'<{draw(cached_sampled_from(("GiveInt", "GiveFloat")))} port="{{{key}}}" out="{{{other}}}"/>'
            )
        return f'<Sleep msec="{{{key}}}"/>'

    def tree(depth: int) -> str:
        kind = draw(cached_integers(0, 9)) if depth else 0
        if kind <= 2:
            return leaf()
        if kind <= 5:
            tag = draw(cached_sampled_from(("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback")))
            return f"<{tag}>{''.join(tree(depth - 1) for _ in range(draw(cached_integers(1, 4))))}</{tag}>"
        key, below = draw(ENTRIES), tree(depth - 1)
        if kind == 6:
            cases = "".join(f'case_{number}="{draw(OTHERS)}" ' for number in (1, 2))
            more = f"{tree(depth - 1)}{tree(depth - 1)}"
            return f'<Switch2 variable="{{{key}}}" {cases}>{below}{more}</Switch2>'
        if kind == 7:
            decorated = (
                f'<Repeat num_cycles="{{{key}}}">{below}</Repeat>',
                f'<RetryUntilSuccessful num_attempts="{{{key}}}">{below}</RetryUntilSuccessful>',
                f'<Timeout msec="{{{key}}}">{below}</Timeout>',
                f'<Delay delay_msec="{{{key}}}">{below}</Delay>',
                f'<Parallel success_count="{{{key}}}">{below}<Sleep msec="10"/></Parallel>',
                f'<RunOnce then_skip="{{{key}}}">{below}</RunOnce>',
            )
            return decorated[draw(cached_integers(0, len(decorated) - 1))]
        if kind == 8:
            code = draw(cached_sampled_from(QUESTIONS))
            return f'<Precondition if="{code}" else="RUNNING">{below}</Precondition>'
        remapped = draw(
            cached_sampled_from(('_autoremap="true"', 'n="{m}" t="{t}"', 'n="3" x="{y}"', 'n="{@m}"'))
        )
        return f'<SubTree ID="Inner" {remapped}/>'

    main, inner = tree(3), leaf()
    return (
        f'<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main">{main}</BehaviorTree>'
        f'<BehaviorTree ID="Inner"><Sequence>{inner}{leaf()}</Sequence></BehaviorTree></root>'
    )


NUMBERS = {int: st.integers(-2, 4), float: st.sampled_from([0.0, 1.0, 2.5, -1.0]), bool: st.booleans()}


@st.composite
def typed_values(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Draw the initial entries of the agents: the same entries with the same types."""
    kinds = {
        "n": NUMBERS[draw(st.sampled_from([int, float, bool]))],
        "m": NUMBERS[draw(st.sampled_from([int, float]))],
        "t": st.sampled_from(["walk", "run", "2"]),
    }
    given = {key: kinds[key] for key in kinds if draw(st.booleans()) or key == "m"}
    return draw(st.lists(st.fixed_dictionaries(given), min_size=1, max_size=4))


TYPED = Registry.standard()
TYPED.add(take_int, take_float, take_bool, take_text, give_int, give_float)


@given(typed_documents(), typed_values())
def test_every_type_of_entry_is_read_and_written_as_in_a_single_tree(
    xml: str, values: list[dict[str, Any]]
) -> None:
    clock = SimClock()
    try:
        singles = []
        for given_values in values:
            board = Blackboard(clock=clock)
            for key, value in given_values.items():
                board[key] = value
            singles.append(btcore.loads(xml, nodes=TYPED, blackboard=board, clock=clock))
    except btcore.TreeError:
        with pytest.raises(btcore.TreeError):
            typed_batch(xml, values, clock)
        return
    many = typed_batch(xml, values, clock)
    for _ in range(3):
        found = ticked(many)
        for at, tree in enumerate(singles):
            try:
                wanted = (int(tree.tick_exactly_once()), False)
            except NodeExecutionError:
                wanted = (0, True)
            assert found[at] == wanted, f"agent {at}"
            assert [int(node.status) for node in tree] == [int(node.status[at]) for node in many], (
                f"agent {at}"
            )
            boards = {
                subtree.path: {key: entry.value for key, entry in subtree.blackboard.local_entries().items()}
                for subtree in tree.subtrees
            }
            assert repr(with_types(entries_of_agent(many, at))) == repr(with_types(boards)), f"agent {at}"
        clock.advance(PERIOD)


def typed_batch(xml: str, values: list[dict[str, Any]], clock: SimClock) -> BatchTree:
    columns = {
        key: np.array([row[key] for row in values], dtype=object if key == "t" else None) for key in values[0]
    }
    leaves = [take_ints, take_floats, take_bools, take_texts, give_ints, give_floats]
    return BatchTree.loads(xml, len(values), leaves, blackboard=columns, clock=clock)
