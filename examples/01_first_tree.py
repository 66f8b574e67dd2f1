"""Define a leaf in Python and a tree in XML, and tick the tree."""

from btcore import In, Registry, condition, loads


@condition
def battery_ok(level: In[float], minimum: In[float] = 0.2) -> bool:
    """SUCCESS if the battery's *level* (0–1) is above *minimum* (0–1)."""
    return level > minimum


nodes = Registry.standard()
nodes.add(battery_ok)

tree = loads(
    """
    <root BTCPP_format="4">
      <BehaviorTree ID="Main">
        <Fallback>
          <BatteryOk level="{battery}"/>
          <Script code="alarm := true"/>
        </Fallback>
      </BehaviorTree>
    </root>""",
    nodes=nodes,
)

for level in (0.9, 0.1):
    tree.blackboard["battery"] = level
    status = tree.tick_once()
    print(f"battery {level:.0%}: {status}, alarm {'on' if 'alarm' in tree.blackboard else 'off'}")
