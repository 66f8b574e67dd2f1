"""Publish a tree, and receive its structure and status changes, as `btcore monitor` does."""

from btcore import Registry, SimClock, loads
from btcore_monitor.events import ConnectionEvent, TransitionEvent, TreeEvent
from btcore_monitor.serve import serve
from btcore_monitor.watch.feed import Feed

tree = loads(
    """
    <root BTCPP_format="4">
      <BehaviorTree ID="Main">
        <Repeat num_cycles="3"> <Sleep msec="500"/> </Repeat>
      </BehaviorTree>
    </root>""",
    nodes=Registry.standard(),
    clock=SimClock(),
)
with serve(tree, groot2_port=0) as publisher:
    feed = Feed(publisher.address)
    tree.tick_while_running(period=0.1)
    publisher.end_stream()
    changes = 0
    for event in feed.events(until_end=True):
        if isinstance(event, TreeEvent):
            print("the tree:", ", ".join(node.name for node in event.tree.nodes))
        elif isinstance(event, TransitionEvent):
            changes += 1
        elif isinstance(event, ConnectionEvent) and event.state == "ended":
            break
    print(changes, "changes of status")
    feed.close()
