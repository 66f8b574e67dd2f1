"""Breakpoints and injected statuses: where they fire, what they change, and how they end."""

import asyncio
import threading
import time
from collections.abc import Callable, Iterator

import pytest

import btcore
from btcore import Observer, Registry, SimClock, StatefulAction, Status, Transition, action, running
from btcore.engine.node import start_tick_counts
from btcore.tree.hooks import Hook, HookMode, HookPosition

TREE = """
<root BTCPP_format="4"><BehaviorTree ID="Main">
  <Fallback name="root">
    <Sequence name="try"><Work name="first"/><Work name="second"/></Sequence>
    <AlwaysSuccess name="rescue"/>
  </Fallback>
</BehaviorTree></root>
"""


def tree_of(xml: str, *leaves: object) -> btcore.Tree:
    nodes = Registry.standard()
    nodes.add(*leaves)
    return btcore.loads(xml, nodes=nodes, resources=[SimClock()])


def body_of(xml: str) -> str:
    return f'<root BTCPP_format="4"><BehaviorTree ID="Main">{xml}</BehaviorTree></root>'


class HookRig:
    """A tree whose leaves record their ticks, and the statuses that an observer received."""

    def __init__(self) -> None:
        self.worked: list[str] = []
        rig = self

        class Work(btcore.SyncAction):
            def tick(self) -> bool:
                rig.worked.append(self.name)
                return True

        self.tree = tree_of(TREE, Work)
        self.seen: list[tuple[str, Status]] = []
        names = {node.uid: node.name for node in self.tree.nodes}
        seen = self.seen

        class Notes(Observer):
            def transition(self, change: Transition) -> None:
                if change.status is not Status.IDLE:
                    seen.append((names[change.uid], change.status))

        self.tree.subscribe(Notes())

    def uid(self, name: str) -> int:
        return self.tree.node(name).uid

    def inject(
        self, name: str, status: Status, position: HookPosition = HookPosition.PRE, **more: bool
    ) -> None:
        assert self.tree.hooks.insert(Hook(self.uid(name), position, HookMode.REPLACE, status, **more))


@pytest.fixture
def rig() -> HookRig:
    return HookRig()


class Ticking:
    """Ticks a tree once on another thread."""

    def __init__(self, tree: btcore.Tree) -> None:
        self.tree = tree
        self.status: Status | None = None
        self.thread = threading.Thread(target=self._tick)
        self.thread.start()

    def _tick(self) -> None:
        self.status = self.tree.tick_once()

    def stands(self) -> bool:
        return any(hook.waiting for hook in self.tree.hooks.all())

    def end(self) -> Status:
        self.thread.join(60)
        assert not self.thread.is_alive(), "the tick still stands"
        assert self.status is not None
        return self.status


def wait_until_true(true: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60
    while not true():
        assert time.monotonic() < deadline, "not within a minute"
        time.sleep(0.001)


@pytest.fixture
def ticking() -> Iterator[Callable[[btcore.Tree], Ticking]]:
    made: list[Ticking] = []

    def start(tree: btcore.Tree) -> Ticking:
        made.append(Ticking(tree))
        return made[-1]

    yield start
    for one in made:
        one.tree.hooks.remove_all()
        one.end()


def test_status_injected_before_the_tick_replaces_the_tick(rig: HookRig) -> None:
    rig.inject("first", Status.FAILURE)
    assert rig.tree.tick_once() is Status.SUCCESS
    assert rig.worked == []
    assert [one for one in rig.seen if one[1] is not Status.RUNNING] == [
        ("first", Status.FAILURE),
        ("try", Status.FAILURE),
        ("rescue", Status.SUCCESS),
        ("root", Status.SUCCESS),
    ]


def test_status_injected_after_the_tick_replaces_the_result(rig: HookRig) -> None:
    rig.inject("second", Status.FAILURE, HookPosition.POST)
    assert rig.tree.tick_once() is Status.SUCCESS
    assert rig.worked == ["first", "second"]
    assert ("second", Status.FAILURE) in rig.seen
    assert ("second", Status.SUCCESS) not in rig.seen


@pytest.mark.parametrize("status", [Status.SKIPPED, Status.RUNNING, Status.IDLE])
@pytest.mark.parametrize("position", list(HookPosition))
def test_only_success_and_failure_are_injected(rig: HookRig, status: Status, position: HookPosition) -> None:
    rig.inject("first", status, position)
    assert rig.tree.tick_once() is Status.SUCCESS
    assert rig.worked == ["first", "second"]


def test_hook_with_once_fires_once_and_is_removed(rig: HookRig) -> None:
    rig.inject("first", Status.FAILURE, once=True)
    rig.tree.tick_once()
    assert rig.tree.hooks.all() == []
    rig.tree.tick_once()
    assert rig.worked == ["first", "second"]


def test_pre_condition_takes_precedence_over_a_hook() -> None:
    tree = tree_of(body_of('<AlwaysSuccess _failureIf="true"/>'))
    tree.hooks.insert(Hook(1, HookPosition.PRE, HookMode.REPLACE, Status.SUCCESS))
    assert tree.tick_once() is Status.FAILURE
    tree.hooks.insert(Hook(1, HookPosition.POST, HookMode.REPLACE, Status.SUCCESS))
    assert tree.tick_once() is Status.SUCCESS


def test_post_conditions_follow_a_pre_hook_status_but_not_a_post_hook_status() -> None:
    tree = tree_of(body_of('<AlwaysSuccess _onFailure="message := 1" _onSuccess="message := 2"/>'))
    tree.hooks.insert(Hook(1, HookPosition.PRE, HookMode.REPLACE, Status.FAILURE))
    tree.tick_once()
    assert tree.blackboard["message"] == 1
    tree.hooks.remove(1)
    tree.hooks.insert(Hook(1, HookPosition.POST, HookMode.REPLACE, Status.FAILURE))
    assert tree.tick_once() is Status.FAILURE
    assert tree.blackboard["message"] == 2


def test_a_skipped_node_is_overridden_after_its_tick() -> None:
    tree = tree_of(body_of('<Sequence><AlwaysSuccess _skipIf="true"/></Sequence>'))
    assert tree.tick_once() is Status.SKIPPED
    tree.hooks.insert(Hook(2, HookPosition.POST, HookMode.REPLACE, Status.FAILURE))
    assert tree.tick_once() is Status.FAILURE


def test_a_running_node_can_be_ended_before_and_after_its_tick() -> None:
    calls = []

    class Lasting(StatefulAction):
        def on_start(self) -> Status:
            calls.append("start")
            return Status.RUNNING

        def on_running(self) -> Status:
            calls.append("running")
            return Status.RUNNING

    tree = tree_of(body_of("<Lasting/>"), Lasting)
    assert tree.tick_once() is Status.RUNNING
    tree.hooks.insert(Hook(1, HookPosition.PRE, HookMode.REPLACE, Status.SUCCESS, once=True))
    assert tree.tick_once() is Status.SUCCESS
    assert calls == ["start"]
    tree.hooks.insert(Hook(1, HookPosition.POST, HookMode.REPLACE, Status.FAILURE, once=True))
    assert tree.tick_once() is Status.FAILURE
    assert calls == ["start", "start"]


def test_hook_for_an_unknown_node_is_refused(rig: HookRig) -> None:
    assert not rig.tree.hooks.insert(Hook(999))
    assert not rig.tree.hooks.unlock(1)
    assert not rig.tree.hooks.remove(1)
    assert rig.tree.hooks.all() == []


def test_hooks_are_listed_with_pre_hooks_first(rig: HookRig) -> None:
    rig.inject("first", Status.FAILURE, HookPosition.POST)
    rig.inject("second", Status.SUCCESS)
    places = [(hook.uid, hook.position) for hook in rig.tree.hooks.all()]
    assert places == [(rig.uid("second"), HookPosition.PRE), (rig.uid("first"), HookPosition.POST)]


def test_tick_counts_continue_beside_hooks(rig: HookRig) -> None:
    tally = start_tick_counts(rig.tree.node("first"))
    rig.inject("first", Status.FAILURE, once=True)
    rig.tree.tick_once()
    rig.tree.tick_once()
    assert (tally.ticks, tally.failure, tally.success) == (2, 1, 1)


def test_two_trees_have_their_own_hooks() -> None:
    one, other = HookRig(), HookRig()
    one.inject("first", Status.FAILURE)
    other.tree.tick_once()
    assert other.worked == ["first", "second"]


def test_user_callbacks_are_called_before_and_after_a_tick(rig: HookRig) -> None:
    asked: list[object] = []
    node = rig.tree.node("first")

    def before(one: btcore.TreeNode) -> Status:
        asked.append(one.name)
        return Status.SKIPPED

    def after(one: btcore.TreeNode, status: Status) -> Status:
        asked.append(status)
        return Status.FAILURE

    node.set_pre_tick_function(before)
    node.set_post_tick_function(after)
    rig.tree.tick_once()
    assert asked == ["first", Status.SUCCESS]
    assert rig.worked == ["first"]
    node.set_pre_tick_function(None)
    node.set_post_tick_function(None)
    rig.tree.tick_once()
    assert len(asked) == 2


def test_duration_of_tick_does_not_count_time_at_breakpoint(rig: HookRig, ticking: type[Ticking]) -> None:
    durations: list[int] = []

    class Durations(Observer):
        def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
            durations.append(duration_ns)

    rig.tree.subscribe(Durations())
    uid = rig.uid("second")
    rig.tree.hooks.insert(Hook(uid))
    began = time.perf_counter_ns()
    run = ticking(rig.tree)
    wait_until_true(run.stands)
    time.sleep(0.3)
    assert rig.tree.hooks.unlock(uid)
    run.end()
    assert 0 < durations[0] < time.perf_counter_ns() - began - 250_000_000


def test_a_breakpoint_stops_the_tick_until_it_is_unlocked(rig: HookRig, ticking: type[Ticking]) -> None:
    fired: list[int] = []
    rig.tree.hooks.subscribe(lambda hook: fired.append(hook.uid))
    uid = rig.uid("second")
    rig.tree.hooks.insert(Hook(uid))
    run = ticking(rig.tree)
    wait_until_true(run.stands)
    assert rig.worked == ["first"]
    assert fired == [uid]
    assert rig.tree.hooks.unlock(uid)
    assert run.end() is Status.SUCCESS
    assert rig.worked == ["first", "second"]
    assert len(rig.tree.hooks.all()) == 1


def test_unlock_sets_the_status_and_may_remove_the_breakpoint(rig: HookRig, ticking: type[Ticking]) -> None:
    uid = rig.uid("second")
    rig.tree.hooks.insert(Hook(uid, HookPosition.POST))
    run = ticking(rig.tree)
    wait_until_true(run.stands)
    rig.tree.hooks.unlock(uid, HookPosition.POST, Status.FAILURE, remove_when_done=True)
    run.end()
    assert rig.worked == ["first", "second"]
    assert ("second", Status.FAILURE) in rig.seen
    assert rig.tree.hooks.all() == []


def test_early_unlock_lets_the_next_tick_pass_once(rig: HookRig, ticking: type[Ticking]) -> None:
    uid = rig.uid("first")
    rig.tree.hooks.insert(Hook(uid))
    rig.tree.hooks.unlock(uid)
    assert rig.tree.tick_once() is Status.SUCCESS
    run = ticking(rig.tree)
    wait_until_true(run.stands)
    rig.tree.hooks.unlock(uid)
    run.end()


@pytest.mark.parametrize("way", ["remove", "remove_all", "disable", "interrupt", "insert disabled"])
def test_ending_breakpoint_continues_tick_unchanged(rig: HookRig, ticking: type[Ticking], way: str) -> None:
    hooks, uid = rig.tree.hooks, rig.uid("first")
    hooks.insert(Hook(uid, desired_status=Status.FAILURE))
    run = ticking(rig.tree)
    wait_until_true(run.stands)
    if way == "remove":
        hooks.remove(uid)
    elif way == "remove_all":
        hooks.remove_all()
    elif way == "disable":
        hooks.enable_all(False)
    elif way == "interrupt":
        rig.tree.interrupt()
    else:
        hooks.insert(Hook(uid, enabled=False, desired_status=Status.FAILURE))
    assert run.end() is Status.SUCCESS
    assert rig.worked == ["first", "second"]


def test_breakpoint_turned_into_a_replacement_uses_its_status(rig: HookRig, ticking: type[Ticking]) -> None:
    uid = rig.uid("first")
    rig.tree.hooks.insert(Hook(uid))
    run = ticking(rig.tree)
    wait_until_true(run.stands)
    rig.inject("first", Status.FAILURE)
    run.end()
    assert rig.worked == []
    assert ("first", Status.FAILURE) in rig.seen


def test_disabled_hooks_work_again_when_enabled(rig: HookRig) -> None:
    rig.inject("first", Status.FAILURE)
    rig.tree.hooks.enable_all(False)
    rig.tree.tick_once()
    rig.tree.hooks.enable_all(True)
    rig.tree.tick_once()
    assert rig.worked == ["first", "second"]


def test_timeout_above_a_breakpoint_fires_after_it() -> None:
    halted = []

    class Lasting(StatefulAction):
        def on_start(self) -> Status:
            return Status.RUNNING

        def on_running(self) -> Status:
            return Status.RUNNING

        def on_halted(self) -> None:
            halted.append(self.name)

    tree = tree_of(body_of('<Timeout msec="100"><Lasting/></Timeout>'), Lasting)
    tree.hooks.insert(Hook(2))
    run = Ticking(tree)
    wait_until_true(run.stands)
    assert isinstance(tree.clock, SimClock)
    tree.clock.wait_until(tree.clock.now() + 10**9, threading.Event())
    tree.hooks.remove(2)
    assert run.end() is Status.FAILURE  # the expired limit requests another tick immediately
    assert halted == ["Lasting"]


def test_hooks_may_be_inserted_and_removed_while_the_tree_ticks() -> None:
    """No hook is left over: in the end the tree works as without hooks."""
    rig = HookRig()
    stop = threading.Event()

    def tick() -> None:
        while not stop.is_set():
            rig.tree.tick_once()

    thread = threading.Thread(target=tick)
    thread.start()
    for turn in range(300):
        uid = 1 + turn % len(rig.tree.nodes)
        position = HookPosition(turn % 2)
        rig.tree.hooks.insert(Hook(uid, position, HookMode(turn // 2 % 2), Status.FAILURE))
        rig.tree.hooks.unlock(uid, position, Status.SKIPPED, turn % 3 == 0)
        rig.tree.hooks.remove(uid, position)
    stop.set()
    thread.join(60)
    assert not thread.is_alive()
    rig.worked.clear()
    assert rig.tree.tick_once() is Status.SUCCESS
    assert rig.worked == ["first", "second"]


# --- under an event loop


async def async_wait_until_true(true: Callable[[], object]) -> int:
    """Wait for *true* to return a true value; return the number of turns of the event loop meanwhile."""
    deadline = time.monotonic() + 60
    turns = 0
    while not true():
        assert time.monotonic() < deadline, "not within a minute"
        turns += 1
        await asyncio.sleep(0.001)
    return turns


@pytest.mark.parametrize("debug", [False, True])
def test_event_loop_keeps_running_at_a_breakpoint(debug: bool) -> None:
    steps: list[str] = []

    @action
    async def fetch() -> bool:
        steps.append("fetch")
        await asyncio.wait_for(asyncio.sleep(0.001), 60)
        steps.append("fetched")
        return True

    tree = tree_of(body_of('<Sequence><Fetch name="page"/><Fetch name="next"/></Sequence>'), fetch)
    tree.hooks.insert(Hook(tree.node("next").uid))

    async def main() -> None:
        run = asyncio.ensure_future(tree.run(period=0.001))
        await async_wait_until_true(lambda: any(hook.waiting for hook in tree.hooks.all()))
        assert steps == ["fetch", "fetched"]
        for _ in range(10):
            await asyncio.sleep(0)
        assert not run.done()
        tree.hooks.unlock(tree.node("next").uid, remove_when_done=True)
        assert await asyncio.wait_for(run, 60) is Status.SUCCESS
        assert asyncio.get_running_loop().get_debug() is debug

    asyncio.run(main(), debug=debug)
    assert steps == ["fetch", "fetched"] * 2
    assert not [one for one in threading.enumerate() if one.name == "btcore-tick"]


def test_cancelled_run_at_a_breakpoint_halts_the_tree() -> None:
    trace: list[str] = []

    @action
    async def hold() -> bool:
        try:
            while True:
                await running()
        finally:
            trace.append("halted")

    xml = '<Parallel success_count="2"><Hold/><AlwaysSuccess name="stop here"/></Parallel>'
    tree = tree_of(body_of(xml), hold)
    tree.hooks.insert(Hook(tree.node("stop here").uid))

    async def main() -> None:
        run = asyncio.ensure_future(tree.run())
        await async_wait_until_true(lambda: any(hook.waiting for hook in tree.hooks.all()))
        run.cancel()
        with pytest.raises(asyncio.CancelledError):
            await run

    asyncio.run(main())
    assert trace == ["halted"]
    assert all(node.status is Status.IDLE for node in tree)
    assert not [one for one in threading.enumerate() if one.name == "btcore-tick"]


def test_breakpoint_set_within_a_tick_does_not_block_the_event_loop() -> None:
    stops: list[int] = []

    @action
    def arm() -> bool:
        if not stops:
            stops.append(1)
            tree.hooks.insert(Hook(tree.node("later").uid, once=True))
        return True

    @action
    async def turn() -> bool:
        await running()
        return True

    xml = '<Repeat num_cycles="2"><Sequence><Arm/><AlwaysSuccess name="later"/><Turn/></Sequence></Repeat>'
    tree = tree_of(body_of(xml), arm, turn)

    async def main() -> None:
        run = asyncio.ensure_future(tree.run())
        await async_wait_until_true(lambda: any(hook.waiting for hook in tree.hooks.all()))
        tree.hooks.remove_all()
        assert await asyncio.wait_for(run, 60) is Status.SUCCESS

    asyncio.run(main())


def test_an_error_in_the_tick_thread_is_raised_by_run() -> None:
    @action
    def explode() -> bool:
        raise ValueError("boom")

    tree = tree_of(body_of("<Explode/>"), explode)
    tree.hooks.insert(Hook(1))

    async def main() -> None:
        run = asyncio.ensure_future(tree.run())
        await async_wait_until_true(lambda: any(hook.waiting for hook in tree.hooks.all()))
        tree.hooks.unlock(1)
        with pytest.raises(btcore.NodeExecutionError, match="boom"):
            await run

    asyncio.run(main())
