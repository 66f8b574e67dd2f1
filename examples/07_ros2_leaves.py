"""Call an action and a service of ROS 2. Needs: pip install 'btcore[ros2]' ros-test-msgs."""

import threading
from typing import Any

import rclpy
from rclpy.action import ActionServer
from rclpy.task import Future
from std_srvs.srv import SetBool
from test_msgs.action import Fibonacci

from btcore import In, Out, Registry, loads
from btcore_ros2.leaves import RosAction, ros_service
from btcore_ros2.session import RosSession
from btcore_ros2.testing import isolate_ros

TREE = """
<root BTCPP_format="4"> <BehaviorTree ID="Main"> <Sequence>
  <SwitchMotors on="true"/> <Count order="6" last="{number}"/>
</Sequence> </BehaviorTree> </root>"""


class Count(RosAction):
    """Let the robot count."""

    action_type = Fibonacci
    action_name = "count"
    server_timeout = wait_for_server_timeout = 20_000  # ms, on a slow machine
    order: In[int]
    last: Out[int]

    def make_goal(self) -> Any:
        return Fibonacci.Goal(order=self.order)

    def on_result(self, result: Any) -> bool:
        self.last = result.sequence[-1]
        return True


@ros_service(SetBool, "switch_motors", server_timeout=20_000, wait_for_server_timeout=20_000)
def switch_motors(on: In[bool]) -> Any:
    return (yield SetBool.Request(data=on)).success


isolate_ros()  # this example talks only to itself
rclpy.init()
robot = rclpy.create_node("robot")  # usually in another process
result = Fibonacci.Result(sequence=[0, 1, 1, 2, 3, 5])
counter = ActionServer(robot, Fibonacci, "count", lambda goal: goal.succeed() or result)
robot.create_service(SetBool, "switch_motors", lambda request, answer: SetBool.Response(success=request.data))
is_done: Future[None] = Future()
spinning = threading.Thread(target=rclpy.spin_until_future_complete, args=[robot, is_done], daemon=True)
spinning.start()
with RosSession() as session:
    nodes = Registry.standard()
    nodes.add(Count, switch_motors)
    tree = loads(TREE, nodes=nodes, resources=[session], clock=session.clock)
    print(tree.tick_while_running(period=0.1), tree.blackboard["number"])
is_done.set_result(None)
spinning.join()
