"""Writers and readers of each entry: across subtrees, remappings, constants and scripts."""

from dataclasses import asdict

from btcore import In, Put, Registry, action
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.read import parse_text
from btcore_drawing.data_flow import DataflowRow, trace_dataflow

TEXT = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence _skipIf="battery &lt; 0.2">
      <Find place="{goal}"/>
      <Script name="count" code="rounds := 1; rounds += step"/>
      <SubTree ID="GoTo" name="there" target="{goal}" reach="0.5"/>
      <SubTree ID="GoTo" name="home" _autoremap="true" reach="{=}"/>
      <SetBlackboard name="keep" value="{goal}" output_key="last"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="GoTo">
    <Drive name="drive" goal="{target}" reach="{reach}" shout="{@cry}" _onSuccess="_done := 1"/>
  </BehaviorTree>
</root>"""


@action
def find(place: Put[str]) -> bool:
    place("here")
    return True


@action
def drive(goal: In[str], reach: In[float], shout: Put[str]) -> bool:
    shout(goal)
    return reach > 0


def table() -> dict[str, DataflowRow]:
    nodes = Registry.standard()
    nodes.add(find, drive)
    plans = plan_document(parse_text(TEXT, "t.xml"), nodes)
    plans.diagnostics.raise_errors()
    return {f"{row.scope}/{row.key}": row for row in trace_dataflow(plans)}


def places(row: DataflowRow) -> tuple[list[str], list[str]]:
    return (
        [f"{writer.node} {writer.attribute}" for writer in row.writers],
        [f"{reader.node} {reader.attribute}" for reader in row.readers],
    )


def test_entry_is_followed_through_remappings_to_its_scope() -> None:
    row = table()["/goal"]
    assert places(row) == (["Find place"], ["there/drive goal", "keep value"])
    assert [reader.key for reader in row.readers] == ["target", "goal"]
    assert row.type == "std::string"


def test_autoremap_uses_the_outer_scope_except_for_private_keys() -> None:
    rows = table()
    assert places(rows["/target"]) == ([], ["home/drive goal"])
    assert places(rows["home/_done"]) == (["home/drive _onSuccess"], [])
    assert places(rows["there/_done"]) == (["there/drive _onSuccess"], [])


def test_subtree_node_writes_a_constant_into_the_inner_scope() -> None:
    assert places(table()["there/reach"]) == (["there reach"], ["there/drive reach"])
    assert places(table()["/reach"]) == ([], ["home/drive reach"])


def test_scripts_are_readers_and_writers() -> None:
    rows = table()
    assert places(rows["/rounds"]) == (["count code"], ["count code"])  # "+=" does both
    assert places(rows["/step"]) == ([], ["count code"])
    assert places(rows["/battery"]) == ([], ["Sequence _skipIf"])


def test_at_sign_addresses_the_root_blackboard() -> None:
    assert places(table()["/cry"]) == (["there/drive shout", "home/drive shout"], [])


def test_set_blackboard_writes_its_output_key() -> None:
    assert places(table()["/last"])[0] == ["keep output_key"]


def test_rows_are_sorted_and_exported_as_plain_data_with_lines() -> None:
    data = [asdict(row) for row in table().values()]
    names = [(row["scope"], row["key"]) for row in data]
    assert names == sorted(names)
    goal = next(row for row in data if row["key"] == "goal")
    assert goal["writers"] == [{"node": "Find", "attribute": "place", "key": "goal", "where": "t.xml:4"}]
