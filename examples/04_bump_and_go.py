"""Drive the simulated Tiago with a tree, in a Python program without a command line or a window."""

import btcore
from btcore_robot import leaves
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

world = World(load_world_description("arena"), seed=3)
robot = SimulatedRobot(world)

nodes = btcore.Registry.standard()
nodes.add_plugin(leaves)
tree = btcore.loads(
    """
    <root BTCPP_format="4">
      <BehaviorTree ID="BumpAndGo">
        <ReactiveSequence>
          <Fallback>
            <Inverter> <IsObstacle distance="1.0"/> </Inverter>
            <Sequence> <Back/> <Turn/> </Sequence>
          </Fallback>
          <Forward/>
        </ReactiveSequence>
      </BehaviorTree>
    </root>""",
    nodes=nodes,
    resources=[robot],
    clock=world,
)
for _ in range(300):  # 30 s at 10 Hz
    tree.tick_once()
    tree.sleep(0.1)
tree.halt()
print(f"{robot.distance:.1f} m, {robot.contacts.collisions} collisions")
world.close()
