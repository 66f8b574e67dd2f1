"""Runs of several trees: what they share, when each is ticked, and how the run ends."""

import signal
import threading
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

import pytest

import btcore
from btcore import FAILURE, RUNNING, SUCCESS, Registry, Run, RunSettings, Status, provider
from btcore.runs.run import TreelessProgram
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_file

FAST = RunSettings(fast=True)
WriteTree = Callable[[str, str], Path]


@pytest.fixture
def write_tree(tmp_path: Path) -> WriteTree:
    """Return a function that writes a tree with the given ID and content, and returns the file."""

    def write(id: str, content: str) -> Path:
        file = tmp_path / f"{id}.xml"
        file.write_text(
            f'<root BTCPP_format="4"><BehaviorTree ID="{id}">{content}</BehaviorTree></root>',
            encoding="utf-8",
        )
        return file

    return write


class Radio(list[str]):
    """What the leaves of all trees have sent."""


class Steps(btcore.TreeResource):
    """How often the leaf of a tree was ticked."""

    def __init__(self) -> None:
        self.count = 0


@provider
def radio() -> Iterator[Radio]:
    shared = Radio()
    yield shared
    shared.append("closed")


@pytest.fixture
def nodes() -> Registry:
    @btcore.action
    def call(
        word: btcore.In[str], times: btcore.In[int], radio: Radio, steps: Steps
    ) -> Generator[None, None, bool]:
        while True:
            steps.count += 1
            radio.append(f"{word} {steps.count}")
            if steps.count == times:
                return True
            yield

    registry = Registry.standard()
    registry.add(call)
    return registry


def test_trees_share_providers_and_are_ticked_in_their_order_until_each_has_ended(
    write_tree: WriteTree, nodes: Registry
) -> None:
    files = [
        write_tree("One", '<Call word="one" times="3"/>'),
        write_tree("Two", '<Call word="two" times="1"/>'),
    ]
    with Run(files, nodes=nodes, providers=[radio], settings=[FAST]) as run:
        assert run.tick_to_end() is SUCCESS
        sent = run.find(Radio)
    assert sent == ["one 1", "two 1", "one 2", "one 3", "closed"]
    assert [tree.id for tree in run.trees] == ["One", "Two"]
    assert [tree.ticks for tree in run.trees] == [3, 1]
    assert run.tree is run.trees[0]
    assert (run.elapsed_s, run.exit_code) == (0.2, 0)


@pytest.mark.parametrize("failing", [0, 1])
def test_the_run_fails_if_one_of_its_trees_fails(write_tree: WriteTree, failing: int) -> None:
    contents = ['<Sleep msec="200"/>', '<Sleep msec="400"/>']
    contents[failing] = f"<Inverter>{contents[failing]}</Inverter>"
    files = [write_tree(f"T{number}", content) for number, content in enumerate(contents)]
    statuses: list[Status] = []
    with Run(files, settings=[FAST]) as run:
        assert run.tick_to_end(on_tick=statuses.append) is FAILURE
    assert statuses == [RUNNING] * 4 + [FAILURE]
    assert (run.end_reason, run.exit_code) == ("done", 1)


def test_a_deadline_gives_its_tree_alone_an_additional_tick(write_tree: WriteTree) -> None:
    files = [
        write_tree("One", '<Sleep msec="1000"/>'),
        write_tree("Two", '<Repeat num_cycles="3"><Sleep msec="130"/></Repeat>'),
    ]
    times: list[tuple[float, ...]] = []
    with Run(files, settings=[FAST]) as run:
        run.tick_to_end(on_tick=lambda _: times.append((run.clock.now() / 1e9, *ticks_of(run))))
    assert times[:6] == [(0.0, 1, 1), (0.1, 2, 2), (0.13, 2, 3), (0.2, 3, 4), (0.26, 3, 5), (0.3, 4, 6)]
    assert run.missed_ticks == 0


def ticks_of(run: Run) -> list[int]:
    return [tree.ticks for tree in run.trees]


def test_a_thread_that_wakes_the_second_tree_ends_the_wait_of_the_run() -> None:
    answers: list[None] = []

    def answer() -> None:
        answers.append(None)
        run.trees[1].wake()

    slow = TreelessProgram("Slow", lambda: not answers)
    waiting = TreelessProgram("Waiting", lambda: not answers)
    timer = threading.Timer(0.01, answer)
    with Run([slow, waiting], settings=[RunSettings(rate=0.001, duration=20)]) as run:
        timer.start()
        run.tick_to_end(on_tick=lambda _: run.tree.wake() if answers else None)
    assert run.elapsed_s < 10


def test_a_program_starts_all_trees_again_when_it_steps(write_tree: WriteTree) -> None:
    files = [write_tree("One", "<AlwaysSuccess/>"), write_tree("Two", '<Sleep msec="200"/>')]
    with Run(files, settings=[FAST]) as run:
        clock = run.clock
        assert isinstance(clock, btcore.SimClock)
        assert [run.step(), run.step()] == [RUNNING, RUNNING]
        clock.advance(0.2)
        assert run.step() is SUCCESS
        assert ticks_of(run) == [1, 3]
        assert run.step() is RUNNING
        assert ticks_of(run) == [2, 4]


def test_an_exception_in_one_tree_halts_the_others(write_tree: WriteTree) -> None:
    class Watch(btcore.StatefulAction):
        def on_start(self) -> Status:
            return RUNNING

        def on_running(self) -> Status:
            return RUNNING

        def on_halted(self) -> None:
            raise OSError("unplugged")

    @btcore.action
    def explode() -> bool:
        raise ValueError("no power")

    nodes = Registry.standard()
    nodes.add(Watch)
    nodes.add(explode)
    files = [write_tree(f"Watch{number}", "<Watch/>") for number in (1, 2)]
    explosive = write_tree("Explosive", '<Sequence><Sleep msec="100"/><Explode/></Sequence>')
    run = Run([*files, explosive], nodes=nodes, settings=[FAST])
    with pytest.raises(btcore.NodeExecutionError, match="no power") as caught, run:
        run.tick_to_end()
    assert [str(error.cause) for error in caught.value.later_errors] == ["unplugged"] * 2
    assert {node.status for tree in run.trees for node in tree.nodes} == {btcore.IDLE}
    with (
        pytest.raises(btcore.NodeExecutionError, match="unplugged") as caught,
        Run(files, nodes=nodes) as run,
    ):
        run.step()
    assert [str(error.cause) for error in caught.value.later_errors] == ["unplugged"]


@pytest.mark.parametrize("signalling", [0, 1])
def test_a_signal_ends_all_trees(signalling: int) -> None:
    def keep_running(number: int) -> Callable[[], bool]:
        def tick() -> bool:
            if number == signalling:
                signal.raise_signal(signal.SIGINT)
            return True

        return tick

    programs = [TreelessProgram(f"P{number}", keep_running(number)) for number in (0, 1)]
    with Run(programs, settings=[FAST]) as run:
        run.tick_to_end()
    assert (run.end_reason, run.exit_code) == ("interrupted", 130)
    assert ticks_of(run) == [1, signalling]
    assert {node.status for tree in run.trees for node in tree.nodes} == {btcore.IDLE}


def test_the_first_tree_can_be_replaced_while_the_others_continue(write_tree: WriteTree) -> None:
    files = [write_tree(f"T{number}", '<Sleep msec="500"/>') for number in (1, 2)]
    replacement = write_tree("New", '<Sleep msec="900"/>')

    def on_tick(status: Status) -> None:
        if run.tree.id == "T1" and run.clock.now() > 0:
            run.tree.halt()
            run.replace_tree(btcore.load(replacement, clock=run.clock))

    with Run(files, settings=[FAST]) as run:
        assert run.tick_to_end(on_tick=on_tick) is SUCCESS
    assert [tree.id for tree in run.trees] == ["New", "T2"]
    assert run.elapsed_s == pytest.approx(1.1)


def test_the_plans_of_one_tree_make_a_tree_for_each_robot(write_tree: WriteTree, nodes: Registry) -> None:
    plans = plan_document(parse_file(write_tree("Main", '<Call word="it" times="2"/>')), nodes)
    with Run([plans, plans], providers=[radio], settings=[FAST]) as run:
        run.tick_to_end()
        assert run.find(Radio) == ["it 1", "it 1", "it 2", "it 2"]


def test_what_the_second_tree_lacks_is_an_error(write_tree: WriteTree, nodes: Registry) -> None:
    files = [write_tree("One", "<AlwaysSuccess/>"), write_tree("Two", '<Call word="two" times="1"/>')]
    with pytest.raises(btcore.TreeError, match=r"Two.xml:1.* Radio"):
        Run(files, nodes=nodes).__enter__()
    with pytest.raises(ValueError, match="there is no run of an empty list"):
        Run([])
    with pytest.raises(RuntimeError, match="write 'with Run"):
        _ = Run(files, nodes=nodes).tree
