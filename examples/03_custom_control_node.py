"""A custom control node that compares the scores of its children and ticks the best child."""

from btcore import RUNNING, ControlNode, In, Registry, Status, action, loads


class Best(ControlNode):
    """Tick the child with the highest score: the blackboard entry with the child's name."""

    def tick(self) -> Status:
        self.set_status(RUNNING)
        best = max(self.children, key=lambda child: self.blackboard.get(child.name, float))
        status = best.execute_tick()
        if status is not RUNNING:
            self.reset_children()
        return status


@action
def say(text: In[str]) -> bool:
    """Print *text*."""
    print(text)
    return True


nodes = Registry.standard()
nodes.add(Best, say)
tree = loads(
    """
    <root BTCPP_format="4">
      <BehaviorTree ID="Main">
        <Best>
          <Say name="work"  text="working"/>
          <Say name="rest"  text="resting"/>
        </Best>
      </BehaviorTree>
    </root>""",
    nodes=nodes,
)
for work, rest in ((0.8, 0.3), (0.2, 0.7)):
    tree.blackboard["work"], tree.blackboard["rest"] = work, rest
    tree.tick_once()
