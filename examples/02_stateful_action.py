"""An action over several ticks, as a class and as a coroutine, on a simulated clock."""

from btcore import RUNNING, SUCCESS, In, Out, Registry, SimClock, StatefulAction, Status, action, loads, sleep


class Drive(StatefulAction):
    """Drive *distance* metres at 0.5 m/s."""

    distance: In[float]
    driven: Out[float]

    def on_start(self) -> Status:
        self.began = self.now()
        return self.on_running()

    def on_running(self) -> Status:
        so_far = (self.now() - self.began) / 1e9 * 0.5
        self.driven = so_far
        return SUCCESS if so_far >= self.distance else RUNNING

    def on_halted(self) -> None:
        print("  brakes")


@action
async def grasp() -> bool:
    """Close the gripper for 2 s, then put it at rest. A halt puts it at rest immediately."""
    try:
        await sleep(2.0)
        return True
    finally:
        print("  gripper at rest")


nodes = Registry.standard()
nodes.add(Drive, grasp)
clock = SimClock()
tree = loads(
    """
    <root BTCPP_format="4">
      <BehaviorTree ID="Main">
        <Sequence>
          <Timeout msec="6000"> <Drive distance="2.5" driven="{metres}"/> </Timeout>
          <Grasp/>
          <ForceSuccess> <Timeout msec="1000"> <Grasp name="too late"/> </Timeout> </ForceSuccess>
        </Sequence>
      </BehaviorTree>
    </root>""",
    nodes=nodes,
    clock=clock,
)
status = tree.tick_while_running(period=0.1)
print(f"{status} after {clock.now() / 1e9} s, {tree.blackboard['metres']} m")
