"""Run the same tree for 5,000 robots that carry food home. With an argument, also draw them to a PNG file."""

import sys

import numpy as np

from btcore import In, InOut, SimClock
from btcore_batch import BatchTree, Floats, Mask, Rows, StatefulAction, Texts

TREE = """
<root BTCPP_format="4"> <BehaviorTree ID="Forage">
  <ReactiveFallback>
    <Sequence _while="battery &lt; 0.3 || charging == 1">
      <Script code="charging := 1"/> <GoTo place="home"/> <Sleep msec="2000"/>
      <Script code="battery := 1.0; charging := 0"/>
    </Sequence>
    <Sequence _skipIf="loaded == 1"> <GoTo place="food"/> <Script code="loaded := 1"/> </Sequence>
    <Sequence> <GoTo place="home"/> <Script code="loaded := 0; trips += 1"/> </Sequence>
  </ReactiveFallback> </BehaviorTree> </root>"""


class GoTo(StatefulAction):
    """Drive 0.25 m per tick towards *place*, until the robot is less than 0.3 m from it."""

    place: In[Texts]
    at: InOut[Rows] = "{at}"
    food: In[Rows] = "{food}"
    battery: InOut[Floats] = "{battery}"

    def on_start(self, mask: Mask) -> object:
        return self.on_running(mask)

    def on_running(self, mask: Mask) -> object:
        way = (self.food if self.place[0] == "food" else 0.0) - self.at
        left = np.linalg.norm(way, axis=1)
        self.at = self.at + way * np.minimum(1.0, 0.25 / np.maximum(left, 1e-9))[:, None]
        self.battery = self.battery - 0.004
        return np.where(left < 0.3, 2, 1)  # 2 is SUCCESS, 1 is RUNNING


draw = np.random.default_rng(seed=1)
food = draw.normal([[9.0, 3.0]], 2.0, (5000, 2)) * draw.choice([-1.0, 1.0], (5000, 1))
begin = {"at": draw.normal(0.0, 1.0, (5000, 2)), "food": food, "battery": draw.uniform(0.2, 1.0, 5000)}
begin |= {"loaded": 0, "charging": 0, "trips": 0}
swarm = BatchTree.loads(TREE, agents=5000, leaves=[GoTo], blackboard=begin, clock=SimClock())
ways = []
for _ in range(600):  # a minute at 10 Hz
    swarm.tick()
    swarm.sleep(0.1)
    ways.append(swarm.blackboard["at"][:40].copy())
print(f"{swarm.blackboard['trips'].sum()} trips, {(swarm.blackboard['battery'] <= 0).sum()} empty batteries")
if len(sys.argv) > 1:
    from matplotlib import pyplot  # pip install matplotlib

    figure, axes = pyplot.subplots(figsize=(8, 5), layout="tight")
    axes.plot(*np.moveaxis(np.array(ways), 2, 0), color="0.8", linewidth=0.5)
    seen = axes.scatter(*swarm.blackboard["at"].T, c=swarm.blackboard["battery"], s=2, cmap="viridis")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    figure.colorbar(seen, label="battery")
    figure.savefig(sys.argv[1], dpi=80)
