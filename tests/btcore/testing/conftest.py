"""Fixtures for the tests of btcore.testing: a small tree with its own leaves."""

from collections.abc import Callable

import pytest

from btcore import Out, Registry, SyncAction, condition
from btcore.testing import Harness, Outcomes, with_mock_leaves

PATROL = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <ReactiveSequence name="patrol">
      <BatteryOk/>
      <SubTree ID="Round" name="round"/>
    </ReactiveSequence>
  </BehaviorTree>
  <BehaviorTree ID="Round">
    <Sequence name="way">
      <Drive name="out"/>
      <Script name="note" code="turns := 1"/>
      <Drive name="back"/>
    </Sequence>
  </BehaviorTree>
</root>"""


@condition
def battery_ok() -> bool:
    raise AssertionError("the real leaf is ticked")


class Drive(SyncAction):
    way: Out[float]

    def tick(self) -> bool:
        raise AssertionError("the real leaf is ticked")


@pytest.fixture
def patrol() -> Callable[..., Harness]:
    """Return a function that builds the tree in a harness; its leaves return *outcomes*."""

    def make(outcomes: str = "S") -> Harness:
        nodes = Registry.standard()
        nodes.add(battery_ok, Drive)
        harness = Harness.loads(PATROL, nodes=with_mock_leaves(nodes))
        Outcomes(outcomes).attach(harness.tree)
        return harness

    return make
