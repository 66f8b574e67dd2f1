"""A tree for many agents: creation, ticks, access, and errors."""

import enum
from pathlib import Path

import pytest

import btcore
from btcore import BlackboardError, BtcoreError, In, InOut, Out, Put, Registry, SimClock, Status, TreeError

np = pytest.importorskip("numpy")
import btcore_batch as batch  # noqa: E402
from btcore_batch import (  # noqa: E402
    BatchNodeError,
    BatchTree,
    Bools,
    Floats,
    Indices,
    Ints,
    Mask,
    Rows,
    Texts,
)
from btcore_batch.columns import infer_type  # noqa: E402


def document(body: str, more: str = "") -> str:
    return (
        '<root BTCPP_format="4" main_tree_to_execute="Main">\n'
        f'<BehaviorTree ID="Main">\n{body}\n</BehaviorTree>\n{more}</root>'
    )


class Calls:
    """The masks and indices with which leaves were called."""

    def __init__(self) -> None:
        self.masks: list[list[bool]] = []
        self.indices: list[list[int]] = []


@batch.condition
def above(level: In[Floats], limit: In[Floats] = 0.5) -> Bools:
    return level > limit


@batch.action
def count(n: In[Ints], out: Put[Ints], mask: Mask, agents: Indices, calls: Calls) -> bool:
    calls.masks.append(mask.tolist())
    calls.indices.append(agents.tolist())
    out(n + 1)
    return True


@batch.action
def brittle(level: In[Floats]) -> object:
    if (level < 0).any():
        raise ValueError("below zero")
    return np.where(level == 0.0, 0, 2)


class Wait(batch.StatefulAction):
    """Is RUNNING for as many ticks as its port contains."""

    ticks: In[Ints]

    def __init__(self, calls: Calls) -> None:
        self.calls = calls
        self.left = np.zeros(self.agents, dtype=int)

    def on_start(self, mask: Mask) -> object:
        self.left[mask] = self.ticks[mask]
        return self.on_running(mask)

    def on_running(self, mask: Mask) -> object:
        self.left[mask] -= 1
        return np.where(self.left < 0, 2, 1)

    def on_halted(self, mask: Mask) -> None:
        self.calls.masks.append(mask.tolist())


class Move(batch.StatefulAction):
    at: InOut[Rows]
    by: In[Rows]

    def on_start(self, mask: Mask) -> object:
        self.at = self.at + self.by
        return True

    def on_running(self, mask: Mask) -> object:
        raise AssertionError("never RUNNING")


# --- ticking


def test_leaves_are_called_once_with_the_mask_of_the_ticked_agents() -> None:
    calls = Calls()
    tree = BatchTree.loads(
        document('<Sequence> <Above level="{level}"/> <Count n="{n}" out="{n}"/> </Sequence>'),
        4,
        [above, count],
        resources=[calls],
        blackboard={"level": [0.1, 0.9, 0.2, 0.8], "n": 3},
    )
    assert tree.tick().tolist() == [3, 2, 3, 2]
    assert calls.masks == [[False, True, False, True]]
    assert calls.indices == [[1, 3]]
    assert tree.blackboard["n"].tolist() == [3, 4, 3, 4]
    assert tree.blackboard["n"].dtype == np.int64


def test_a_mask_selects_the_ticked_agents() -> None:
    tree = BatchTree.loads(document('<Script code="n := n + 1"/>'), 3, blackboard={"n": 0})
    assert tree.tick(np.array([True, False, True])).tolist() == [2, 0, 2]
    assert tree.blackboard["n"].tolist() == [1, 0, 1]
    assert tree.tick().tolist() == [2, 2, 2]
    assert tree.status.tolist() == [2, 2, 2]
    assert tree.ticks == 2
    with pytest.raises(BtcoreError, match=r"a mask must have 3 bools, .*; this has the shape \(2,\)"):
        tree.tick(np.array([True, False]))


def test_only_running_agents_of_the_mask_are_halted() -> None:
    calls = Calls()
    tree = BatchTree.loads(
        document('<Wait ticks="{t}"/>'), 4, [Wait], resources=[calls], blackboard={"t": [0, 2, 2, 9]}
    )
    assert tree.tick().tolist() == [2, 1, 1, 1]
    tree.halt(np.array([True, True, False, False]))
    assert calls.masks == [[False, True, False, False]]
    assert tree.node("Wait").status.tolist() == [0, 0, 1, 1]
    assert tree.tick().tolist() == [2, 1, 1, 1]
    assert tree.tick(np.array([False, False, True, False])).tolist() == [0, 0, 2, 0]


def test_a_sleep_starts_for_each_agent_at_its_first_tick() -> None:
    tree = BatchTree.loads(document('<Sleep msec="100"/>'), 2, clock=SimClock())
    assert tree.tick(np.array([True, False])).tolist() == [1, 0]
    tree.sleep(0.06)
    assert tree.tick().tolist() == [1, 1]
    tree.sleep(0.06)
    assert tree.tick().tolist() == [2, 1]
    tree.sleep(0.06)
    assert tree.tick().tolist() == [1, 2]


def test_tick_once_ticks_woken_agents_again() -> None:
    tree = BatchTree.loads(
        document('<Repeat num_cycles="{times}"> <Script code="n += 1"/> </Repeat>'),
        3,
        blackboard={"times": [1, 3, 0], "n": 0},
    )
    assert tree.tick_once().tolist() == [2, 2, 2]
    assert tree.blackboard["n"].tolist() == [1, 3, 0]


def test_rows_of_numbers_are_columns() -> None:
    tree = BatchTree.loads(
        document('<Move at="{at}" by="{by}"/>'),
        2,
        [Move],
        blackboard={"at": np.zeros((2, 3)), "by": np.array([[1.0, 0, 0], [0, 2.0, 0]])},
    )
    tree.tick(np.array([False, True]))
    tree.tick()
    assert tree.blackboard["at"].tolist() == [[1.0, 0, 0], [0, 4.0, 0]]


def test_a_batch_is_made_of_a_loaded_tree() -> None:
    nodes = Registry.standard()

    @btcore.condition(ID="Above")
    def above_for_a_single_agent(level: In[float], limit: In[float] = 0.5) -> bool:
        return level > limit

    nodes.add(above_for_a_single_agent)
    ordinary = btcore.loads(document('<Above level="{level}"/>'), nodes=nodes)
    ordinary.blackboard["level"] = 0.7
    swarm = BatchTree(ordinary, 3, [above])
    swarm.blackboard["level"] = [0.1, 0.6, 0.7]
    assert swarm.tick().tolist() == [3, 2, 2]
    assert ordinary.tick_once() is Status.SUCCESS
    assert ordinary.blackboard["level"] == 0.7


def test_subtrees_have_their_own_scopes() -> None:
    inner = '<BehaviorTree ID="Inner"><Script code="mine := n; n := n + 1; deep := mine"/></BehaviorTree>\n'
    tree = BatchTree.loads(
        document('<SubTree ID="Inner" name="in" n="{total}"/>', inner), 2, blackboard={"total": [1, 5]}
    )
    tree.tick()
    assert tree.blackboard["total"].tolist() == [2, 6]
    assert tree.blackboards["in"]["deep"].tolist() == [1, 5]
    assert "deep" not in tree.blackboard


# --- inputs


@batch.action
def swap(a: In[Floats], b: In[Floats], to_a: Put[Floats], to_b: Put[Floats]) -> bool:
    to_a(b)
    to_b(a)
    return True


class Count(batch.StatefulAction):
    """Counts to three from its first value."""

    n: InOut[Floats]

    def on_start(self, mask: Mask) -> object:
        self.first = self.n
        return self.on_running(mask)

    def on_running(self, mask: Mask) -> object:
        self.n = self.n + 1.0
        return np.where(self.n - self.first >= 3.0, 2, 1)


@pytest.mark.parametrize("is_held", [False, True])
def test_later_writes_do_not_change_what_a_leaf_has_read(is_held: bool) -> None:
    swapping = document('<Swap a="{a}" b="{b}" to_a="{a}" to_b="{b}"/>')
    tree = BatchTree.loads(swapping, 2, [swap], blackboard={"a": [1.0, 2.0], "b": 3.0})
    kept = tree.blackboard["a"] if is_held else None
    tree.tick(np.array([True, False]))
    assert tree.blackboard["a"].tolist() == [3.0, 2.0]
    assert tree.blackboard["b"].tolist() == [1.0, 3.0]
    if kept is not None:
        assert tree.blackboard["a"] is kept
        kept[1] = 9.0
        tree.tick()
        assert tree.blackboard["b"].tolist() == [3.0, 9.0]
    counting = BatchTree.loads(document('<Count n="{n}"/>'), 2, [Count], blackboard={"n": [0.0, 5.0]})
    if is_held:
        kept = counting.blackboard["n"]
    assert [counting.tick().tolist() for _ in range(3)] == [[1, 1], [1, 1], [2, 2]]


def test_inputs_are_read_only() -> None:
    @batch.action(ID="Grow")
    def grow(n: In[Floats]) -> bool:
        n += 1.0
        return True

    tree = BatchTree.loads(document('<Grow n="{n}"/>'), 2, [grow], blackboard={"n": 0.0})
    with pytest.raises(BatchNodeError, match="read-only"):
        tree.tick()
    assert tree.blackboard["n"].tolist() == [0.0, 0.0]


# --- errors


def test_errors_with_the_same_message_are_merged() -> None:
    tree = BatchTree.loads(
        document('<Above level="{level}"/>'), 30, [above], blackboard={"level": ["low"] * 29 + ["0.7"]}
    )
    with pytest.raises(
        BatchNodeError, match=r"for agents 0, 1, 2, 3, 4 and 24 more: .*'low' is not a number"
    ) as raised:
        tree.tick()
    assert not raised.value.later_errors
    assert raised.value.statuses.tolist() == [0] * 29 + [2]
    tree.blackboard["level"] = [f"at {number}" for number in range(30)]
    with pytest.raises(BatchNodeError, match=r"'at 9' is not a number\n(.*\n)*and 20 more$") as raised:
        tree.tick()
    assert len(raised.value.later_errors) == 29


def test_agents_with_an_error_are_halted_and_the_tick_of_the_others_is_completed() -> None:
    tree = BatchTree.loads(
        document('<Sequence name="all"> <Brittle level="{level}"/> <Script code="n += 1"/> </Sequence>'),
        3,
        [brittle],
        blackboard={"level": [1.0, 0.0, 2.0], "n": 0},
    )
    with pytest.raises(BatchNodeError) as raised:
        tree.tick()
    assert raised.value.agents.tolist() == [1]
    assert raised.value.statuses.tolist() == [2, 0, 2]
    assert tree.blackboard["n"].tolist() == [1, 0, 1]
    assert str(raised.value).startswith(
        "for agent 1: <text>:3: node 'Brittle::2' <Brittle> raised while ticking"
    )
    assert raised.value.backtrace == ["all", "Brittle::2"]


def test_an_exception_applies_to_all_agents_of_the_mask() -> None:
    tree = BatchTree.loads(
        document('<Brittle level="{level}" _skipIf="level == 7"/>'),
        3,
        [brittle],
        blackboard={"level": [1.0, -1.0, 7.0]},
    )
    with pytest.raises(BatchNodeError, match=r"for agents 0, 1: .*ValueError: below zero") as raised:
        tree.tick()
    assert isinstance(raised.value.__cause__, ValueError)
    assert raised.value.statuses.tolist() == [0, 0, 4]


def test_agents_without_a_value_fail_alone() -> None:
    tree = BatchTree.loads(document('<Above level="{level}"/>'), 3, [above])
    tree.blackboard.set("level", 0.9, np.array([True, False, True]))
    assert tree.blackboard.has("level").tolist() == [True, False, True]
    with pytest.raises(BatchNodeError, match=r"port \[level\] reads \{level\}, which has never been written"):
        tree.tick()
    assert tree.status.tolist() == [2, 0, 2]


@pytest.mark.parametrize(
    ("returned", "message"),
    [
        (None, "not None"),
        (np.zeros(2, dtype=bool), r"not an array of the type bool and the shape \(2,\)"),
        (np.full(3, 9), r"ticked agent needs a status: 1 \(RUNNING\)"),
        (Status.RUNNING, "must complete within its tick, but it returned RUNNING"),
        (np.array(["S", "S", "S"]), "not an array of the type <U1"),
    ],
)
def test_leaf_must_return_bools_or_statuses(returned: object, message: str) -> None:
    @batch.action(ID="Leaf")
    def leaf() -> object:
        return returned

    tree = BatchTree.loads(document("<Leaf/>"), 3, [leaf])
    with pytest.raises(BatchNodeError, match=message) as raised:
        tree.tick()
    assert raised.value.agents.tolist() == [0, 1, 2]


@pytest.mark.parametrize(("returned", "status"), [(True, 2), (False, 3), (Status.SKIPPED, 4), (np.True_, 2)])
def test_a_single_result_applies_to_all_agents(returned: object, status: int) -> None:
    @batch.action(ID="Leaf")
    def leaf() -> object:
        return returned

    assert BatchTree.loads(document("<Leaf/>"), 3, [leaf]).tick().tolist() == [status] * 3


# --- invalid trees, leaves and arguments


@pytest.mark.parametrize(
    ("body", "message", "hint"),
    [
        ('<UnsetBlackboard key="k"/>', "does not run <UnsetBlackboard>", "write it for all agents at once"),
        (
            '<LoopInt queue="1;2"><AlwaysSuccess/></LoopInt>',
            "does not run <LoopInt>",
            "it runs AlwaysFailure",
        ),
        ('<Script code="{code}"/>', "the script of <Script> is on the blackboard", 'code="…"'),
        ('<Script code=""/>', "the script of <Script> is empty", 'code="…"'),
        ('<SetBlackboard value="1" output_key="{k}"/>', "needs value", "without braces"),
        ('<Count n="1" out="{n}"/>', "<Count> needs a resource of type Calls", "resources=[…]"),
    ],
)
def test_errors_about_unsupported_nodes_have_a_place_and_a_hint(
    body: str, message: str, hint: str, tmp_path: Path
) -> None:
    file = tmp_path / "tree.xml"
    file.write_text(document(f"<Sequence>\n{body}\n</Sequence>"), encoding="utf-8")
    with pytest.raises(TreeError) as refused:
        BatchTree.load(file, 10, [count], blackboard={"code": "n := 1"})
    (diagnostic,) = refused.value.diagnostics
    assert (diagnostic.code, diagnostic.line, Path(diagnostic.file).name) == ("E120", 4, "tree.xml")
    assert message in diagnostic.message
    assert hint in diagnostic.hint


def test_two_resources_of_one_type_raise() -> None:
    xml = document('<Count n="1" out="{n}"/>')
    message = "2 resources of the class Calls fit the parameter 'calls' of <Count>"
    with pytest.raises(TreeError, match=message):
        BatchTree.loads(xml, 10, [count], resources=[Calls(), Calls()])


def test_format_3_is_rejected() -> None:
    with pytest.raises(TreeError, match="runs trees of format 4, and 'Main' is of format 3"):
        BatchTree.loads('<root><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>', 2)


def test_errors_in_the_xml_are_those_of_the_ordinary_engine() -> None:
    with pytest.raises(TreeError, match="E101 unknown node <Abov>"):
        BatchTree.loads(document('<Abov level="1"/>'), 2, [above])
    with pytest.raises(TreeError, match="E202"):
        BatchTree.loads(document('<Above level="high"/>'), 2, [above])


def test_generators_and_empty_batches_are_rejected() -> None:
    def steps() -> object:
        yield

    with pytest.raises(btcore.RegistrationError, match=r"derive a class from batch\.StatefulAction"):
        BatchTree.loads(document("<Steps/>"), 2, [steps])
    with pytest.raises(BtcoreError, match="at least one agent, not 0"):
        BatchTree.loads(document("<AlwaysSuccess/>"), 0)


@btcore.action(ID="Above")
def for_single_agent(level: In[float]) -> bool:
    return level > 0.5


@batch.action
def assigning(n: InOut[Floats]) -> bool:
    return True


@pytest.mark.parametrize(
    ("nodes", "message"),
    [
        (above, "a list of leaves, not <function above"),
        (Registry.standard(), "pass a Registry as nodes=…"),
        ([above, above], "two leaves <Above>"),
        ([for_single_agent], "for_single_agent is a leaf for a single agent"),
        ([assigning], r"parameter 'n' of assigning can't be assigned: annotate an output with Put\[…\]"),
    ],
)
def test_invalid_leaves_are_rejected(nodes: object, message: str) -> None:
    with pytest.raises(btcore.RegistrationError, match=message):
        BatchTree.loads(document("<AlwaysSuccess/>"), 2, nodes)  # type: ignore[arg-type]


@pytest.mark.parametrize("agents", [2.0, "2", None, True])
def test_the_number_of_agents_must_be_an_integer(agents: object) -> None:
    with pytest.raises(BtcoreError, match="the number of agents must be an integer, not"):
        BatchTree.loads(document("<AlwaysSuccess/>"), agents)  # type: ignore[arg-type]


@pytest.mark.parametrize("mask", [[True], [0, 1], [[True], [True, False]], 1])
def test_invalid_masks_are_rejected(mask: object) -> None:
    tree = BatchTree.loads(document("<AlwaysSuccess/>"), 2)
    with pytest.raises(BtcoreError, match="a mask must have 2 bools, one per agent"):
        tree.tick(mask)  # type: ignore[arg-type]


@pytest.mark.parametrize("values", [[], [1.0, 2.0, 3.0], [[1.0], [2.0, 3.0]]])
def test_invalid_columns_are_rejected(values: object) -> None:
    with pytest.raises(BlackboardError, match="cannot write the blackboard entry 'level': "):
        BatchTree.loads(document('<Above level="{level}"/>'), 2, [above], blackboard={"level": values})


def test_reals_do_not_fit_an_entry_of_integers() -> None:
    tree = BatchTree.loads(
        document('<Count n="{n}" out="{n}"/>'), 2, [count], resources=[Calls()], blackboard={"n": 3}
    )
    with pytest.raises(BlackboardError, match="cannot write the blackboard entry 'n': "):
        tree.blackboard["n"] = [2.0, 2.5]
    assert tree.blackboard["n"].dtype == np.int64
    assert tree.blackboard["n"].tolist() == [2, 3]


def test_inputs_cannot_be_assigned_and_outputs_cannot_be_read() -> None:
    class Reading(batch.StatefulAction):
        n: Out[Floats]

        def on_start(self, mask: Mask) -> object:
            return self.n > 0

    class Assigning(batch.StatefulAction):
        n: In[Floats]

        def on_start(self, mask: Mask) -> object:
            self.n = np.ones(2)
            return True

    for leaf, message in (
        (Reading, "'n' is an output; it can be assigned"),
        (Assigning, "'n' is an input; it can be read"),
    ):
        tree = BatchTree.loads(document(f'<{leaf.__name__} n="{{n}}"/>'), 2, [leaf], blackboard={"n": 0.0})
        with pytest.raises(BatchNodeError, match=message):
            tree.tick()


# --- the blackboard


def test_a_column_keeps_its_type() -> None:
    tree = BatchTree.loads(document('<Above level="{level}"/>'), 2, [above])
    tree.blackboard["level"] = 1
    assert tree.blackboard["level"].dtype == np.float64
    tree.blackboard["level"] = np.array([0.25, 0.75], dtype=np.float32)
    assert tree.blackboard["level"].tolist() == [0.25, 0.75]
    for wrong in ("high", [1.0, 2.0, 3.0]):
        with pytest.raises(BlackboardError, match="cannot write the blackboard entry 'level'"):
            tree.blackboard["level"] = wrong
    with pytest.raises(BlackboardError, match=r"entry 'levle' does not exist; did you mean 'level'\?"):
        tree.blackboard["levle"]
    assert list(tree.blackboard) == ["level"]


def test_texts_in_scripts_and_switches() -> None:
    tree = BatchTree.loads(
        document(
            '<Switch2 variable="{mode}" case_1="walk" case_2="run"> <Script code="v := 1"/> '
            "<Script code=\"v := 2; mode := 'rest'\"/> <ScriptCondition code=\"mode == 'rest'\"/> </Switch2>"
        ),
        3,
        blackboard={"mode": np.array(["walk", "run", "stand"], dtype=object), "v": 0},
    )
    assert tree.tick().tolist() == [2, 2, 3]
    assert tree.tick().tolist() == [2, 2, 3]
    assert tree.blackboard["v"].tolist() == [1, 2, 0]
    assert tree.blackboard["mode"].tolist() == ["walk", "rest", "stand"]


def test_text_ports_contain_python_strings() -> None:
    @batch.condition(ID="Is")
    def is_there(word: In[Texts]) -> Bools:
        return np.array([text.startswith("a") for text in word])

    tree = BatchTree.loads(document('<Is word="{word}"/>'), 2, [is_there], blackboard={"word": ["ab", "ba"]})
    assert tree.tick().tolist() == [2, 3]


def test_a_node_is_found_by_name_or_path() -> None:
    tree = BatchTree.loads(document('<Sequence><AlwaysSuccess name="a"/><AlwaysSuccess/></Sequence>'), 2)
    assert [node.uid for node in tree] == [1, 2, 3]
    assert tree.node("a") is tree.nodes[1]
    assert tree.node("AlwaysSuccess::3") is tree.nodes[2]
    with pytest.raises(BtcoreError, match=r"the tree has no node 'Sequense'; did you mean 'Sequence'\?"):
        tree.node("Sequense")
    assert repr(tree) == "<BatchTree 'Main' of 3 nodes for 2 agents>"


def test_a_batch_starts_with_the_values_of_the_loaded_tree() -> None:
    class Mode(enum.IntEnum):
        SLOW = 1

    outside = btcore.Blackboard()
    outside["limit"] = 3
    board = btcore.Blackboard(outside)
    board.autoremap = True
    board["mode"] = Mode.SLOW
    board["route"] = ["a", "b"]
    tree = BatchTree(btcore.loads(document('<ScriptCondition code="limit == 3"/>'), blackboard=board), 2)
    assert tree.tick().tolist() == [2, 2]
    assert tree.blackboard["mode"].tolist() == [Mode.SLOW] * 2
    assert isinstance(tree.blackboard["mode"][0], Mode)
    assert tree.blackboard["route"].tolist() == [["a", "b"]] * 2


def test_rows_in_a_conditional_expression() -> None:
    tree = BatchTree.loads(
        document('<Script code="x := n &gt; 1 ? p : q"/>'),
        2,
        blackboard={"n": [1, 2], "p": np.ones((2, 3)), "q": np.zeros((2, 3))},
    )
    assert tree.tick().tolist() == [2, 2]
    assert [row.tolist() for row in tree.blackboard["x"]] == [[0.0] * 3, [1.0] * 3]


def test_a_copied_text_is_converted_for_an_entry_behind_a_remapping() -> None:
    inner = (
        '<BehaviorTree ID="Inner"><Sequence> <SetBlackboard value="{word}" output_key="n"/> '
        '<Script code="n += 1"/> </Sequence></BehaviorTree>\n'
    )
    tree = BatchTree.loads(
        document('<SubTree ID="Inner" n="{total}" word="{word}"/>', inner),
        2,
        blackboard={"total": 1, "word": np.array(["5", "x"], dtype=object)},
    )
    with pytest.raises(BatchNodeError, match="'x' is not an integer") as raised:
        tree.tick()
    assert raised.value.statuses.tolist() == [2, 0]
    assert tree.blackboard["total"].tolist() == [6, 1]


def test_copy_of_numbers_to_an_entry_of_another_type_raises() -> None:
    tree = BatchTree.loads(
        document('<SetBlackboard value="{a}" output_key="b"/>'), 2, blackboard={"a": [1, 2], "b": [0.5, 0.5]}
    )
    with pytest.raises(BatchNodeError, match="'b' cannot change from double to int"):
        tree.tick()


@pytest.mark.parametrize(("value", "name"), [("1", "long"), ("0.5 + 0.5", "double")])
def test_copy_of_scripts_number_to_integer_entry_raises_as_in_ordinary_tree(value: str, name: str) -> None:
    body = f'<Sequence><Script code="e := {value}"/><SetBlackboard value="{{e}}" output_key="b"/></Sequence>'
    tree = BatchTree.loads(document(body), 2, blackboard={"b": [1, 2]})
    with pytest.raises(BatchNodeError, match=f"'b' cannot change from int to {name}"):
        tree.tick()
    ordinary = btcore.loads(document(body))
    ordinary.blackboard["b"] = 1
    with pytest.raises(btcore.NodeExecutionError, match=f"'b' cannot change from int to {name}"):
        ordinary.tick_once()


def test_smallest_integer_of_64_bits_is_not_exact_as_a_double() -> None:
    numbers = np.array([-(2**63), 1])
    assert infer_type(numbers) is btcore.values.INT64
    swarm = BatchTree.loads(document('<Script code="w := v + 1"/>'), agents=2, blackboard={"v": numbers})
    with pytest.raises(BatchNodeError, match="-9223372036854775808 is too large"):
        swarm.tick()


def test_smallest_integer_of_32_bits_is_an_int() -> None:
    assert infer_type(np.array([-(2**31), 5])) is btcore.values.INT
    assert infer_type(np.array([-(2**31) - 1, 5])) is btcore.values.INT64
