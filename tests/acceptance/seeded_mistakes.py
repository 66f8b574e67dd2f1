"""Good trees, and mistakes in them: each replaces texts in a tree's XML so that a question is violated."""

from dataclasses import dataclass
from typing import ClassVar

import btcore
from btcore import DecoratorNode, NodeSpec, Status
from btcore.engine.control import ControlNode


class Supervised(DecoratorNode):
    """Fails when the entry `stop` is true, and halts its child then."""

    spec = NodeSpec(state_fields=())
    forgets: ClassVar[bool] = False

    def tick(self) -> Status:
        """Tick the child unless `stop` is true."""
        self.set_status(Status.RUNNING)
        if self.blackboard.get("stop") is True:
            if not self.forgets:
                self.halt_child()
            return Status.FAILURE
        status = self.child.execute_tick()
        if status is not Status.RUNNING:
            self.reset_child()
        return status


class ForgetfulSupervised(Supervised):
    """Forgets to halt its child."""

    forgets: ClassVar[bool] = True


class FirstOfAll(ControlNode):
    """Ticks all children, and ends with the first child that ends."""

    spec = NodeSpec(state_fields=())
    forgets: ClassVar[bool] = False

    def tick(self) -> Status:
        """Tick the children in order until a child ends."""
        self.set_status(Status.RUNNING)
        for child in self.children:
            status = child.execute_tick()
            if status is not Status.RUNNING:
                if not self.forgets:
                    self.reset_children()
                return status
        return Status.RUNNING


class ForgetfulFirstOfAll(FirstOfAll):
    """Forgets to halt the other children."""

    forgets: ClassVar[bool] = True


def registry() -> btcore.Registry:
    """Return the standard nodes, and the control nodes and decorators of this module."""
    nodes = btcore.Registry.standard()
    for cls in (Supervised, ForgetfulSupervised, FirstOfAll, ForgetfulFirstOfAll):
        nodes.add(cls)
    return nodes


@dataclass(frozen=True)
class GoodTree:
    """A tree about which all standard questions and its own are proved.

    Attributes:
        xml: The content of the main tree, and further trees.
        leaves: The models of the leaves: conditions end in a question mark; output and input ports follow,
            as in `Look >count:int` and `Report <share`.
        questions: The tree's own questions.
        declarations: The TOML text of the declarations.
        mistakes: The replacements of each mistake, by its name: old, new, old, new …
    """

    xml: str
    leaves: str
    questions: tuple[str, ...]
    mistakes: dict[str, tuple[str, ...]]
    declarations: str = ""
    more: str = ""


TREES: dict[str, GoodTree] = {
    "charge": GoodTree(
        """
        <Sequence>
          <CheckBattery level="{battery}"/>
          <Fallback>
            <ScriptCondition code="battery == 'ok'"/>
            <Sequence> <Recharge/> <Script code="battery := 'ok'"/> </Sequence>
          </Fallback>
          <Move/>
        </Sequence>""",
        "CheckBattery >level; Recharge; Move",
        (
            "never {battery} == 'low' & Move ticked",
            "never {battery} == 'ok' & Recharge",
            "CheckBattery is SUCCESS before Move ticked",
        ),
        {
            "recharges before it looks at the battery": (
                """<ScriptCondition code="battery == 'ok'"/>""",
                "",
                """</Sequence>
          </Fallback>""",
                """</Sequence> <ScriptCondition code="battery == 'ok'"/>
          </Fallback>""",
            ),
            "does not note that the battery is full": ("""<Script code="battery := 'ok'"/>""", ""),
            "does not check the battery": ("<CheckBattery ", """<CheckBattery _skipIf="true" """),
            "checks the battery at the end": (
                """<CheckBattery level="{battery}"/>""",
                "",
                "<Move/>",
                """<Move/> <CheckBattery level="{battery}"/>""",
            ),
            "writes another entry": ("""level="{battery}\"""", """level="{batery}\""""),
            "compares with a value that never occurs": ("battery == 'ok'", "battery == 'full'"),
            "a Sequence for the Fallback": ("<Fallback>", "<Sequence>", "</Fallback>", "</Sequence>"),
            "the opposite comparison": ("battery == 'ok'", "battery != 'ok'"),
            "a script that assigns instead of comparing": (
                """<ScriptCondition code="battery == 'ok'"/>""",
                """<Script code="battery = 'ok'"/>""",
            ),
            "reads an entry with a wrong name": ("code=\"battery == 'ok'\"", "code=\"level == 'ok'\""),
        },
        """
        [leaves.CheckBattery]
        results = ["SUCCESS"]
        lasts = false
        [entries]
        battery = ["low", "ok"]
        """,
    ),
    "obstacle": GoodTree(
        """
        <ReactiveFallback>
          <ReactiveSequence> <PathFree/> <Drive/> </ReactiveSequence>
          <Stop/>
        </ReactiveFallback>""",
        "PathFree?; Drive; Stop",
        (
            "never Drive & !(PathFree is SUCCESS)",
            "PathFree is FAILURE leads to Stop ticked",
            "never Stop & !(PathFree ticked)",
        ),
        {
            "a Sequence for the ReactiveSequence": (
                "<ReactiveSequence>",
                "<Sequence>",
                "</ReactiveSequence>",
                "</Sequence>",
            ),
            "a SequenceWithMemory for the ReactiveSequence": (
                "<ReactiveSequence>",
                "<SequenceWithMemory>",
                "</ReactiveSequence>",
                "</SequenceWithMemory>",
            ),
            "drives before it looks": ("<PathFree/> <Drive/>", "<Drive/> <PathFree/>"),
            "does not look": ("<PathFree/>", """<PathFree _skipIf="true"/>"""),
            "a Fallback for the ReactiveFallback": ("ReactiveFallback", "Fallback"),
            "a ReactiveSequence for the ReactiveFallback": ("ReactiveFallback", "ReactiveSequence"),
            "an Inverter too many": ("<PathFree/>", "<Inverter><PathFree/></Inverter>"),
            "stops while it drives": (
                "<ReactiveFallback>",
                """<Parallel failure_count="2">""",
                "</ReactiveFallback>",
                "</Parallel>",
            ),
            "drives if the path is not free": (
                "<ReactiveSequence>",
                "<Fallback>",
                "</ReactiveSequence>",
                "</Fallback>",
            ),
            "ignores the condition": ("<PathFree/>", "<ForceSuccess><PathFree/></ForceSuccess>"),
            "a pause that starts again and again": ("<PathFree/>", """<PathFree/> <Sleep msec="1000"/>"""),
            "does not stop": ("<Stop/>", """<Stop _skipIf="true"/>"""),
        },
        """
        [leaves.Drive]
        at_once = false
        uses = ["base"]
        hands_over = true
        [leaves.Stop]
        uses = ["base"]
        hands_over = true
        """,
    ),
    "grasp": GoodTree(
        """
        <Fallback>
          <Sequence>
            <RetryUntilSuccessful num_attempts="3">
              <Sequence> <Approach/> <Grasp/> </Sequence>
            </RetryUntilSuccessful>
            <Lift/>
          </Sequence>
          <GiveUp/>
        </Fallback>""",
        "Approach; Grasp; Lift; GiveUp",
        (
            "Grasp is SUCCESS before Lift ticked",
            "Approach is SUCCESS before Grasp ticked",
            "Grasp is SUCCESS leads to Lift ticked within 0 ticks",
            "Approach ticked leads to Lift ticked | GiveUp ticked",
            "Approach ticked before GiveUp ticked",
            "never GiveUp ticked & Lift is SUCCESS",
        ),
        {
            "retries forever": ("""num_attempts="3\"""", """num_attempts="-1\""""),
            "grasps only if it cannot approach": (
                "<Sequence> <Approach/> <Grasp/> </Sequence>",
                "<Fallback> <Approach/> <Grasp/> </Fallback>",
            ),
            "grasps before it approaches": ("<Approach/> <Grasp/>", "<Grasp/> <Approach/>"),
            "lifts before it grasps": (
                "<Lift/>",
                "",
                """<RetryUntilSuccessful num_attempts="3">""",
                """<Lift/> <RetryUntilSuccessful num_attempts="3">""",
            ),
            "repeats instead of retrying": (
                """RetryUntilSuccessful num_attempts""",
                """Repeat num_cycles""",
                "</RetryUntilSuccessful>",
                "</Repeat>",
            ),
            "lifts although the grasp failed": ("<Grasp/>", "<ForceSuccess><Grasp/></ForceSuccess>"),
            "keeps running until it fails": (
                """RetryUntilSuccessful num_attempts="3\"""",
                "KeepRunningUntilFailure",
                "</RetryUntilSuccessful>",
                "</KeepRunningUntilFailure>",
            ),
            "gives up after success": ("<Fallback>", "<Sequence>", "</Fallback>", "</Sequence>"),
            "gives up first": ("<GiveUp/>", "", "<Fallback>", "<Fallback> <GiveUp/>"),
            "an Inverter too many": ("<Grasp/>", "<Inverter><Grasp/></Inverter>"),
            "no attempts": ("""num_attempts="3\"""", """num_attempts="0\""""),
            "retries forever what cannot succeed": (
                """num_attempts="3\"""",
                """num_attempts="-1\"""",
                "<Grasp/>",
                "<Grasp/> <AlwaysFailure/>",
            ),
        },
    ),
    "call": GoodTree(
        """
        <Fallback>
          <Timeout msec="5000">
            <Sequence> <Call/> <Delay delay_msec="1000"> <Confirm/> </Delay> </Sequence>
          </Timeout>
          <Cancel/>
        </Fallback>""",
        "Call; Confirm; Cancel",
        (
            "Call is SUCCESS before Confirm ticked",
            "Call ticked leads to Confirm is SUCCESS | Cancel ticked",
            "never Confirm ticked & Call ticked",
            "never Confirm & Cancel",
        ),
        {
            "a Timeout shorter than the Delay": ("""msec="5000\"""", """msec="500\""""),
            "without the Timeout": (
                """<Timeout msec="5000">""",
                "<ForceSuccess>",
                "</Timeout>",
                "</ForceSuccess>",
            ),
            "a Timeout of 0, which never expires": ("""msec="5000\"""", """msec="0\""""),
            "the Timeout around one child only": (
                """<Timeout msec="5000">""",
                '<Delay delay_msec="10">',
                "</Timeout>",
                "</Delay>",
                "<Call/>",
                """<Call/>""",
                "<Confirm/>",
                """<Timeout msec="5000"> <Confirm/> </Timeout>""",
            ),
            "confirms only if the call failed": ("<Sequence>", "<Fallback>", "</Sequence>", "</Fallback>"),
            "confirms before it calls": ("<Call/> <Delay", "<Delay", "</Delay>", "</Delay> <Call/>"),
            "cancels always": ("<Fallback>", "<Sequence>", "</Fallback>", "</Sequence>"),
            "hides the expired Timeout": (
                """<Timeout msec="5000">""",
                """<ForceSuccess> <Timeout msec="5000">""",
                "</Timeout>",
                "</Timeout> </ForceSuccess>",
            ),
            "confirms without a pause": ("""<Delay delay_msec="1000"> <Confirm/> </Delay>""", "<Confirm/>"),
            "waits longer than the Timeout": ("<Call/>", """<Sleep msec="6000"/> <Call/>"""),
        },
        """
        [leaves.Call]
        endless = true
        """,
    ),
    "share": GoodTree(
        """
        <Sequence>
          <Look count="{count}"/>
          <ScriptCondition code="count > 0"/>
          <Script code="share := 100 / count"/>
          <Report share="{share}"/>
        </Sequence>""",
        "Look >count:int; Report <share:double",
        ("never {share} > 1000", "never {share} < 10", "Look is SUCCESS before Report ticked"),
        {
            "an unguarded division": ("""<ScriptCondition code="count > 0"/>""", ""),
            "a guard that admits 0": ("count > 0", "count >= 0"),
            "the guard after the division": (
                """<ScriptCondition code="count > 0"/>""",
                "",
                "<Report",
                """<ScriptCondition code="count > 0"/> <Report""",
            ),
            "a guard of an entry that is not written": ("count > 0", "number > 0"),
            "without the division": ("""<Script code="share := 100 / count"/>""", ""),
            "the result in another entry": ("share := 100", "shares := 100"),
            "another entry at the input": ("""share="{share}\"""", """share="{shares}\""""),
            "another entry at the output": ("""count="{count}\"""", """count="{counts}\""""),
            "a Fallback for the Sequence": ("<Sequence>", "<Fallback>", "</Sequence>", "</Fallback>"),
            "the wrong way round": ("100 / count", "count / 100"),
            "an impossible guard": ("count > 0", "count > 100"),
        },
        """
        [leaves.Look]
        lasts = false
        [entries]
        count = [0, 1, 4]
        """,
    ),
    "tour": GoodTree(
        """
        <Sequence>
          <Script code="places := 'hall;lab'"/>
          <LoopString queue="{places}" value="{place}"> <GoTo place="{place}"/> </LoopString>
          <Tell/>
        </Sequence>""",
        "GoTo <place; Tell",
        (
            "GoTo is SUCCESS before Tell ticked",
            "never {place} == ''",
            "GoTo is FAILURE leads to GoTo is FAILURE within 0 ticks",
            "never GoTo is FAILURE & Tell ticked",
            "{place} == 'lab' before Tell ticked",
        ),
        {
            "an empty queue": ("'hall;lab'", "''"),
            "a queue that is not written": ("""<Script code="places := 'hall;lab'"/>""", ""),
            "a queue with another name": ("places :=", "place_list :="),
            "a value with another name": ("""value="{place}\"""", """value="{goal}\""""),
            "an empty place": ("'hall;lab'", "'hall;;lab'"),
            "one place only": ("'hall;lab'", "'hall'"),
            "the queue after the loop": (
                """<Script code="places := 'hall;lab'"/>""",
                "",
                "<Tell/>",
                """<Script code="places := 'hall;lab'"/> <Tell/>""",
            ),
            "goes on after a failure": (
                """<GoTo place="{place}"/>""",
                """<ForceSuccess><GoTo place="{place}"/></ForceSuccess>""",
            ),
            "fails at the end of the queue": (
                """value="{place}">""",
                """value="{place}" if_empty="FAILURE">""",
            ),
            "no loop": (
                """<LoopString queue="{places}" value="{place}">""",
                "<Sequence>",
                "</LoopString>",
                "</Sequence>",
            ),
        },
    ),
    "door": GoodTree(
        """
        <Sequence>
          <IfThenElse> <DoorOpen/> <Enter/> <Knock/> </IfThenElse>
          <Greet/>
        </Sequence>""",
        "DoorOpen?; Enter; Knock; Greet",
        (
            "DoorOpen is SUCCESS before Enter ticked",
            "DoorOpen is FAILURE before Knock ticked",
            "Enter is SUCCESS | Knock is SUCCESS before Greet ticked",
            "never Enter ticked & Knock ticked",
        ),
        {
            "a condition that may be skipped": ("<DoorOpen/>", """<DoorOpen _skipIf="true"/>"""),
            "a condition that is skipped by an entry": ("<DoorOpen/>", """<DoorOpen _skipIf="closed"/>"""),
            "the branches swapped": ("<Enter/> <Knock/>", "<Knock/> <Enter/>"),
            "the condition last": ("<DoorOpen/> <Enter/> <Knock/>", "<Enter/> <Knock/> <DoorOpen/>"),
            "an Inverter too many": ("<DoorOpen/>", "<Inverter><DoorOpen/></Inverter>"),
            "a Fallback for the IfThenElse": ("IfThenElse", "Fallback"),
            "a Sequence for the IfThenElse": ("IfThenElse", "Sequence"),
            "greets first": ("<Greet/>", "", "<IfThenElse>", "<Greet/> <IfThenElse>"),
            "the condition has always succeeded": ("<DoorOpen/>", "<ForceSuccess><DoorOpen/></ForceSuccess>"),
            "does not knock": ("<Knock/>", """<Knock _skipIf="true"/>"""),
            "a Fallback for the Sequence": ("<Sequence>", "<Fallback>", "</Sequence>", "</Fallback>"),
        },
    ),
    "survey": GoodTree(
        """
        <Sequence>
          <Parallel success_count="-1" failure_count="1"> <Navigate/> <Scan/> </Parallel>
          <Report/>
        </Sequence>""",
        "Navigate; Scan; Report",
        (
            "Navigate is SUCCESS before Report ticked",
            "Scan is SUCCESS before Report ticked",
            "never Navigate & Scan is FAILURE",
            "never Navigate is FAILURE & Scan",
        ),
        {
            "success with one child": ("""success_count="-1\"""", """success_count="1\""""),
            "success with all except one": ("""success_count="-1\"""", """success_count="-2\""""),
            "more successes than children": ("""success_count="-1\"""", """success_count="3\""""),
            "one success is enough": (
                """success_count="-1" failure_count="1\"""",
                """success_count="1" failure_count="-1\"""",
            ),
            "failure without a failure": ("""failure_count="1\"""", """failure_count="0\""""),
            "more failures than children": ("""failure_count="1\"""", """failure_count="4\""""),
            "a ParallelAll that tolerates failures": (
                """<Parallel success_count="-1" failure_count="1">""",
                """<ParallelAll max_failures="2">""",
                "</Parallel>",
                "</ParallelAll>",
            ),
            "a Fallback for the Parallel": (
                """<Parallel success_count="-1" failure_count="1">""",
                "<Fallback>",
                "</Parallel>",
                "</Fallback>",
            ),
            "reports meanwhile": (
                "<Scan/> </Parallel>",
                "<Scan/> <Report/> </Parallel>",
                "</Parallel>\n          <Report/>",
                "</Parallel>",
            ),
            "reports first": ("<Report/>", "", "<Parallel", "<Report/> <Parallel"),
            "hides a failure": ("<Scan/>", "<ForceSuccess><Scan/></ForceSuccess>"),
        },
    ),
    "dock": GoodTree(
        """
        <Sequence>
          <FindDock pose="{dock}"/>
          <SubTree ID="Approach" goal="{dock}" result="{distance}"/>
          <ScriptCondition code="distance == 'near'"/>
          <Attach/>
        </Sequence>""",
        "FindDock >pose; Plan <goal >path; Follow <path >left; Attach",
        (
            "FindDock is SUCCESS before Follow ticked",
            "never {distance} == 'far' & Attach ticked",
            "Plan is SUCCESS before Follow ticked",
        ),
        {
            "a port that is not remapped": ("""goal="{dock}" """, ""),
            "a port that is remapped to another entry": ("""goal="{dock}\"""", """goal="{doc}\""""),
            "a result that is not remapped": (""" result="{distance}\"""", ""),
            "a result with another name": ("""result="{distance}\"""", """result="{dist}\""""),
            "the subtree first": (
                """<FindDock pose="{dock}"/>""",
                "",
                "<ScriptCondition",
                """<FindDock pose="{dock}"/> <ScriptCondition""",
            ),
            "another key in the subtree": ("""<Plan goal="{goal}\"""", """<Plan goal="{target}\""""),
            "follows before it plans": (
                """<Plan goal="{goal}" path="{path}"/>""",
                "",
                """left="{result}"/>""",
                """left="{result}"/> <Plan goal="{goal}" path="{path}"/>""",
            ),
            "does not plan": ("<Plan ", """<Plan _skipIf="true" """),
            "attaches from afar": ("distance == 'near'", "distance != 'near'"),
            "does not check the distance": ("""<ScriptCondition code="distance == 'near'"/>""", ""),
            "attaches on failure": (
                "<Sequence>\n          <FindDock",
                "<Fallback>\n          <FindDock",
                "<Attach/>\n        </Sequence>",
                "<Attach/>\n        </Fallback>",
            ),
        },
        """
        [entries]
        distance = ["near", "far"]
        result = ["near", "far"]
        """,
        """
        <BehaviorTree ID="Approach">
          <Sequence> <Plan goal="{goal}" path="{path}"/> <Follow path="{path}" left="{result}"/> </Sequence>
        </BehaviorTree>""",
    ),
    "supervised": GoodTree(
        """
        <ReactiveSequence>
          <Watch stop="{stop}"/>
          <FirstOfAll>
            <Supervised> <Sequence> <Cut/> <Clean/> </Sequence> </Supervised>
            <Alarm/>
          </FirstOfAll>
        </ReactiveSequence>""",
        "Watch >stop:bool; Cut; Clean; Alarm",
        (
            "Cut is SUCCESS before Clean ticked",
            "never Cut & {stop} == true",
            "never Clean ticked & {stop} == true",
        ),
        {
            "a decorator that forgets to halt": (
                "<Supervised>",
                "<ForgetfulSupervised>",
                "</Supervised>",
                "</ForgetfulSupervised>",
            ),
            "a control node that forgets to halt": ("FirstOfAll", "ForgetfulFirstOfAll"),
            "both forget to halt": (
                "<Supervised>",
                "<ForgetfulSupervised>",
                "</Supervised>",
                "</ForgetfulSupervised>",
                "FirstOfAll",
                "ForgetfulFirstOfAll",
            ),
            "cleans before it cuts": ("<Cut/> <Clean/>", "<Clean/> <Cut/>"),
            "cleans only if it cannot cut": ("<Sequence>", "<Fallback>", "</Sequence>", "</Fallback>"),
            "is not supervised": ("<Supervised>", "<ForceSuccess>", "</Supervised>", "</ForceSuccess>"),
        },
        """
        [leaves.Watch]
        results = ["SUCCESS"]
        lasts = false
        """,
    ),
    "mode": GoodTree(
        """
        <Sequence>
          <Choose mode="{mode}"/>
          <Switch2 variable="{mode}" case_1="slow" case_2="fast"> <Creep/> <Run/> <Wait/> </Switch2>
          <Done/>
        </Sequence>""",
        "Choose >mode; Creep; Run; Wait; Done",
        (
            "never {mode} != 'slow' & Creep ticked",
            "never {mode} != 'fast' & Run ticked",
            "never {mode} != 'off' & Wait ticked",
            "Choose is SUCCESS before Done ticked",
            "Creep ticked | Run ticked | Wait ticked before Done ticked",
        ),
        {
            "a case that never occurs": ("""case_1="slow\"""", """case_1="slwo\""""),
            "two children swapped": ("<Creep/> <Run/>", "<Run/> <Creep/>"),
            "the default swapped with a case": ("<Run/> <Wait/>", "<Wait/> <Run/>"),
            "another entry": ("""variable="{mode}\"""", """variable="{modes}\""""),
            "a text for an entry": ("""variable="{mode}\"""", """variable="mode\""""),
            "the cases swapped": ("""case_1="slow" case_2="fast\"""", """case_1="fast" case_2="slow\""""),
            "the same case twice": ("""case_2="fast\"""", """case_2="slow\""""),
            "does not choose": ("<Choose ", """<Choose _skipIf="true" """),
            "chooses afterwards": (
                """<Choose mode="{mode}"/>""",
                "",
                "<Done/>",
                """<Choose mode="{mode}"/> <Done/>""",
            ),
            "is done first": ("<Done/>", "", "<Switch2", "<Done/> <Switch2"),
        },
        """
        [leaves.Choose]
        results = ["SUCCESS"]
        [entries]
        mode = ["slow", "fast", "off"]
        """,
    ),
    "conditions": GoodTree(
        """
        <Sequence>
          <Ask paused="{paused}" _onSuccess="asked := true"/>
          <Turn _skipIf="paused"/>
          <Push _failureIf="paused" _onFailure="failed := true" _onSuccess="failed := false"/>
          <Shout _while="!paused &amp;&amp; asked"/>
        </Sequence>""",
        "Ask >paused:bool; Turn; Push; Shout",
        (
            "never Turn & {paused} == true",
            "never Push & {paused} == true",
            "never {failed} == true & Shout ticked",
            "never Push is FAILURE & {failed} == false",
            "{paused} == true leads to Push is FAILURE within 0 ticks",
        ),
        {
            "skips in the wrong case": ("""_skipIf="paused\"""", """_skipIf="!paused\""""),
            "without the skip": (""" _skipIf="paused\"""", ""),
            "fails in the wrong case": ("""_failureIf="paused\"""", """_failureIf="!paused\""""),
            "without the failure": (""" _failureIf="paused\"""", ""),
            "an unknown entry in a condition": ("""_skipIf="paused\"""", """_skipIf="pause\""""),
            "an entry that is not written": (""" _onSuccess="asked := true\"""", ""),
            "writes another entry": ("""paused="{paused}\"""", """paused="{pause}\""""),
            "the post-conditions swapped": (
                "failed := true",
                "failed := 1 < 0",
                "failed := false",
                "failed := 1 > 0",
            ),
            "succeeds instead of failing": ("_failureIf", "_successIf"),
            "never shouts": ("!paused &amp;&amp; asked", "paused &amp;&amp; asked"),
        },
        """
        [leaves.Ask]
        results = ["SUCCESS"]
        lasts = false
        """,
    ),
}
