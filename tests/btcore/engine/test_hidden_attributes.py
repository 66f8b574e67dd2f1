"""Ports with the name of an attribute of TreeNode: the engine, the logs and the drawings do not read them."""

import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import btcore
from btcore import RUNNING, SUCCESS, In, Registry, SimClock, Status, TreeNode
from btcore.engine.coroutine import CoroutineAction
from btcore.engine.signature import _MAY_BE_HIDDEN
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs.btlog import BtLog, read_btlog
from btcore.logs.console import ConsoleLog
from btcore.nodes.entry_updates import SkipUnlessUpdated
from btcore.nodes.loop import LoopInt
from btcore.nodes.timing import Delay, Sleep, Timeout
from btcore.testing.coverage import Coverage
from btcore.testing.trace import Trace, format_trace
from btcore_monitor.logs import TraceLog
from btcore_recorder import TreeObserver

DOCUMENT = """<root BTCPP_format="4" main_tree_to_execute="Main"><BehaviorTree ID="Main"><Together>
  <Wait msec="20"/>  <Later delay_msec="15"><Check/></Later>  <Limit msec="30"><Work/></Limit>
  <Rounds queue="1;2"><Once/></Rounds>  <Updated entry="{entry}"><Nap/></Updated>  <Block/>
  <SubTree ID="Other"/>
</Together></BehaviorTree><BehaviorTree ID="Other"><Once name="other"/></BehaviorTree></root>"""


class Together(btcore.ControlNode):
    def tick(self) -> Status:
        self.set_status(RUNNING)
        statuses = [child.execute_tick() for child in self.children if child.name != "Block"]
        return RUNNING if RUNNING in statuses else SUCCESS


class Check(btcore.Condition):
    def tick(self) -> bool:
        return False


class Once(btcore.SyncAction):
    def tick(self) -> bool:
        return True


class Work(btcore.StatefulAction):
    def on_start(self) -> Status:
        self.wake_at(btcore.TreeNode.now(self) + 10)
        return RUNNING

    def on_running(self) -> Status:
        return RUNNING


class Nap(CoroutineAction):
    def create_body(self) -> Any:
        async def body() -> bool:
            await btcore.sleep(0.01)
            return False

        return body()


class Block(btcore.ThreadedAction):
    def work(self) -> Status:
        return SUCCESS


CLASSES: dict[str, type[TreeNode]] = {
    "Block": Block,
    "Check": Check,
    "Later": Delay,
    "Limit": Timeout,
    "Nap": Nap,
    "Once": Once,
    "Rounds": LoopInt,
    "Together": Together,
    "Updated": SkipUnlessUpdated,
    "Wait": Sleep,
    "Work": Work,
}


def nodes(hides: bool) -> Registry:
    """Return a registry with CLASSES; if *hides*, each has a port for each name that may be hidden."""
    registry = Registry.standard()
    for id, cls in CLASSES.items():
        ports = dict.fromkeys(sorted(_MAY_BE_HIDDEN), In[str]) if hides else {}
        values = dict.fromkeys(ports, "value of a port")
        registry.add(type(id, (cls,), {"__annotations__": ports, "__module__": __name__, **values}), ID=id)
    return registry


def reports(hides: bool, folder: Path) -> list[str]:
    """Return what the engine and its tools report about a run of DOCUMENT."""
    clock, console, coverage = SimClock(), io.StringIO(), Coverage()
    tree = btcore.loads(DOCUMENT, nodes=nodes(hides), clock=clock)
    tree.blackboard["entry"] = 1
    coverage.watch(tree)
    json, btlog = folder / "run.json", folder / "run.btlog"
    trace, statistics = Trace(tree), TreeObserver(tree)
    found = []
    with ConsoleLog(tree, console, relative=True), TraceLog(tree, json), BtLog(tree, btlog):
        for _ in range(8):
            clock.advance(0.005)
            found += [str(tree.tick_once()), str(tree)]
    found += [
        console.getvalue(),
        format_trace(trace, 100),
        str([each.transitions_count for each in statistics.statistics().values()]),
        coverage.report(),
    ]
    found += [
        str([*tree.nodes_by_path()]),
        re.sub(r' \w+="value of a port"', "", tree_to_xml(tree, False).partition("<TreeNodesModel")[0]),
    ]
    changes = [change._replace(stamp=0) for change in read_btlog(btlog).transitions]
    return [*found, str(changes), str(len(json.read_text()))]


def test_reports_do_not_depend_on_ports_that_hide_attributes(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    (tmp_path / "hiding").mkdir()
    assert reports(True, tmp_path / "hiding") == reports(False, tmp_path / "plain")


@pytest.mark.parametrize("name", sorted(_MAY_BE_HIDDEN))
def test_port_may_hide_an_attribute(name: str) -> None:
    class Reads(btcore.SyncAction):
        def tick(self) -> bool:
            return getattr(self, name) == "a" != getattr(super(), name)

    Reads.__annotations__ = {name: In[str]}
    registry = Registry.standard()
    registry.add(Reads)
    b = btcore.Builder(registry)
    assert b.build(b.Reads(**{name: "a"})).tick_once() is SUCCESS


def test_dataclass_may_have_a_port_that_hides_an_attribute() -> None:
    @dataclass
    class Follow(btcore.SyncAction):
        path: In[str]

        def tick(self) -> bool:
            return self.path == "road"

    registry = Registry.standard()
    registry.add(Follow)
    b = btcore.Builder(registry)
    assert registry.manifests["Follow"].ports["path"].default is None
    assert b.build(b.Follow(path="road")).tick_once() is SUCCESS


def test_resource_may_hide_an_attribute() -> None:
    class Road:
        pass

    class Follow(btcore.SyncAction):
        path: Road  # type: ignore[assignment]

        def tick(self) -> bool:
            return isinstance(self.path, Road)

    registry = Registry.standard()
    registry.add(Follow)
    b = btcore.Builder(registry)
    assert b.build(b.Follow(), resources=[Road()]).tick_once() is SUCCESS
