"""Substitution rules and TestNode, in code and from JSON, as in BehaviorTree.CPP.

A number at the end of a test's name, such as `issue_934`, is that of an issue of BehaviorTree.CPP.
"""

import json
from pathlib import Path

import pytest

import btcore
from btcore import (
    Blackboard,
    ControlNode,
    In,
    NodeExecutionError,
    NodeType,
    RegistrationError,
    Registry,
    SimClock,
    StatefulAction,
    Status,
    Tree,
    TreeError,
    action,
    condition,
)
from btcore.testing import SubstitutionError, TestNode, TestNodeConfig, load_substitution_rules

XML = """
<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <Sequence>
      <Charged name="charged"/>
      <SubTree ID="Patrol" name="patrol"/>
      <Drive name="home" speed="0.5" _onSuccess="arrived := true"/>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Patrol">
    <Fallback name="try">
      <Drive name="out" speed="1.5"/>
      <Drive name="back" speed="2"/>
    </Fallback>
  </BehaviorTree>
</root>"""


class Motors:
    """A resource that the real leaves require and that the tests do not provide."""


@condition
def charged(motors: Motors) -> bool:
    raise AssertionError("the real leaf is ticked")


@action
def drive(speed: In[float], motors: Motors) -> bool:
    raise AssertionError("the real leaf is ticked")


@pytest.fixture
def nodes() -> Registry:
    registry = Registry.standard()
    registry.add(charged, drive)
    registry.substitute("Charged", "AlwaysSuccess")
    return registry


def load(nodes: Registry, text: str = XML, blackboard: Blackboard | None = None) -> Tree:
    return btcore.loads(text, nodes=nodes, clock=SimClock(), blackboard=blackboard)


# --- the nodes that a rule matches


@pytest.mark.parametrize(
    ("filter", "replaced"),
    [
        ("Drive", ["patrol/out", "patrol/back", "home"]),
        ("home", ["home"]),
        ("out", ["patrol/out"]),
        ("patrol/*", ["patrol/try"]),
        ("patrol/???", ["patrol/try"]),
        ("patrol/???*k", ["patrol/back"]),
        ("*", ["Sequence::1"]),
        ("Sequence::?", ["Sequence::1"]),
        ("patrol", ["patrol"]),
        ("SubTree", ["patrol"]),
        ("patrol/[a-z]*", []),
        ("h.me", []),
        ("PATROL/OUT", []),
    ],
)
def test_rule_matches_an_id_a_name_or_a_path_with_wildcards(filter: str, replaced: list[str]) -> None:
    registry = Registry.standard()
    registry.add(charged, drive)
    registry.substitute(filter, TestNodeConfig())
    for id in {"Charged", "Drive"} - {filter}:
        registry.substitute(id, "AlwaysSuccess")
    assert [node.path for node in load(registry).find(TestNode)] == replaced


def test_rule_that_matches_no_node_changes_nothing(nodes: Registry) -> None:
    nodes.substitute("Drive", "AlwaysFailure")
    before = [node.path for node in load(nodes)]
    nodes.substitute("nobody/*", TestNodeConfig())
    tree = load(nodes)
    assert [node.path for node in tree] == before
    assert tree.find(TestNode) == []


def test_first_matching_rule_applies(nodes: Registry) -> None:
    nodes.substitute("home", TestNodeConfig(return_status=Status.FAILURE))
    nodes.substitute("Drive", TestNodeConfig())
    assert load(nodes).tick_once() is Status.FAILURE


def test_new_rule_replaces_the_rule_of_the_same_filter(nodes: Registry) -> None:
    nodes.substitute("Drive", TestNodeConfig(return_status=Status.FAILURE))
    nodes.substitute("Drive", TestNodeConfig())
    assert load(nodes).tick_once() is Status.SUCCESS


def test_cleared_rules_restore_the_real_nodes(nodes: Registry) -> None:
    nodes.substitute("Drive", TestNodeConfig())
    nodes.substitutions.clear()
    with pytest.raises(TreeError, match="Motors"):
        load(nodes)


def test_registry_copy_has_its_own_rules(nodes: Registry) -> None:
    other = nodes.copy()
    other.substitute("Drive", TestNodeConfig())
    other.remove("Charged")
    tree = load(other, XML.replace("<Charged", "<AlwaysSuccess"))
    assert tree.tick_once() is Status.SUCCESS
    assert list(nodes.substitutions) == ["Charged"]
    assert "Charged" in nodes


# --- what a substituted node keeps


def test_substituted_node_keeps_its_id_name_path_ports_and_conditions(nodes: Registry) -> None:
    nodes.substitute("Drive", TestNodeConfig())
    tree = load(nodes)
    home = tree.node("home")
    assert isinstance(home, TestNode)
    assert (home.id, home.name, home.path, home.uid) == ("Drive", "home", "home", 7)
    assert home.get_input("speed") == 0.5
    assert home.type is NodeType.ACTION
    assert tree.tick_once() is Status.SUCCESS
    assert tree.blackboard["arrived"] == 1


def test_function_or_class_may_substitute_and_reads_the_same_ports(nodes: Registry) -> None:
    speeds: list[float] = []

    @action
    def pretend(speed: In[float]) -> bool:
        speeds.append(speed)
        return True

    class Refuse(StatefulAction):
        speed: In[float]

        def on_start(self) -> Status:
            speeds.append(-self.speed)
            return Status.FAILURE

        def on_running(self) -> Status:
            return Status.FAILURE

    nodes.substitute("out", Refuse)
    nodes.substitute("Drive", pretend)
    assert load(nodes).tick_once() is Status.SUCCESS
    assert speeds == [-1.5, 2, 0.5]
    assert "Pretend" not in nodes


def test_substituted_control_node_keeps_the_children(nodes: Registry) -> None:
    class Backwards(ControlNode):
        def tick(self) -> Status:
            return self.children[-1].execute_tick()

    nodes.substitute("Drive", "AlwaysFailure")
    nodes.substitute("back", "AlwaysSuccess")
    nodes.substitute("try", Backwards)
    tree = load(nodes)
    tree.tick_exactly_once()
    assert tree.node("out").status is Status.IDLE
    assert tree.node("try").id == "Fallback"


def test_children_of_a_node_replaced_by_a_leaf_are_not_built_issue_934(nodes: Registry) -> None:
    nodes.substitute("patrol", TestNodeConfig())
    nodes.substitute("home", "AlwaysSuccess")
    tree = load(nodes)
    assert [node.path for node in tree] == ["Sequence::1", "charged", "patrol", "home"]
    assert [subtree.id for subtree in tree.subtrees] == ["Main"]
    assert tree.tick_once() is Status.SUCCESS


def test_rules_apply_in_format_3_too() -> None:
    nodes = Registry.standard()
    nodes.add(charged)
    nodes.substitute("charged", TestNodeConfig(return_status=Status.FAILURE))
    tree = load(nodes, '<root><BehaviorTree ID="M"><Charged name="charged"/></BehaviorTree></root>')
    assert tree.tick_once() is Status.FAILURE


def test_rule_with_an_unknown_node_is_refused_at_the_replaced_node(nodes: Registry) -> None:
    nodes.substitute("patrol/*", "AlwaysSucess")
    with pytest.raises(TreeError) as refused:
        load(nodes)
    message = str(refused.value)
    assert "<text>:11:5: E118" in message
    assert "'patrol/*' replaces <Fallback> by 'AlwaysSucess'" in message
    assert "did you mean 'AlwaysSuccess'?" in message


@pytest.mark.parametrize(
    ("filter", "by", "message"),
    [
        (
            "home",
            "Inverter",
            "replaces <Drive> by <Inverter>, which needs exactly one child, but <Drive> has none",
        ),
        ("try", "Inverter", "but <Fallback> has 2"),
        ("home", "Sequence", "replaces <Drive> by <Sequence>, which needs children"),
        ("home", "SubTree", "which needs exactly one child"),
    ],
)
def test_rule_whose_node_requires_other_children_is_refused(
    nodes: Registry, filter: str, by: str, message: str
) -> None:
    nodes.substitute(filter, by)
    nodes.substitute("Drive", "AlwaysSuccess")
    with pytest.raises(TreeError, match="E118") as refused:
        load(nodes)
    assert message in str(refused.value)


def test_object_that_is_not_a_node_cannot_substitute(nodes: Registry) -> None:
    with pytest.raises(RegistrationError, match="3 is neither a function nor a node class"):
        nodes.substitute("Drive", 3)


# --- TestNode


def load_test_node(settings: TestNodeConfig, attributes: str = "") -> Tree:
    nodes = Registry.standard()
    nodes.substitute("leaf", settings)
    xml = f'<AlwaysSuccess name="leaf" {attributes}/>'
    return load(nodes, f'<root BTCPP_format="4"><BehaviorTree ID="M">{xml}</BehaviorTree></root>')


@pytest.mark.parametrize("status", [Status.SUCCESS, Status.FAILURE, Status.SKIPPED, Status.RUNNING])
def test_result_without_delay_comes_in_the_first_tick(status: Status) -> None:
    assert load_test_node(TestNodeConfig(return_status=status)).tick_exactly_once() is status


def test_idle_is_refused_as_a_result() -> None:
    with pytest.raises(ValueError, match="cannot be IDLE"):
        TestNodeConfig(return_status=Status.IDLE)


def test_delayed_node_runs_until_its_delay_and_wakes_the_tree() -> None:
    tree = load_test_node(TestNodeConfig(return_status=Status.FAILURE, async_delay=250))
    assert tree.tick_while_running(period=10.0) is Status.FAILURE
    assert (tree.ticks, tree.clock.now()) == (2, 250_000_000)


def test_halted_delay_is_cancelled_and_restarts() -> None:
    tree = load_test_node(TestNodeConfig(async_delay=250))
    tree.tick_once()
    tree.sleep(0.2)
    tree.halt()
    assert tree.context.deadlines == {}
    assert tree.tick_once() is Status.RUNNING
    tree.sleep(0.2)
    assert tree.tick_once() is Status.RUNNING
    tree.sleep(0.05)
    assert tree.tick_once() is Status.SUCCESS


def test_result_script_and_post_script_run_at_the_end() -> None:
    settings = TestNodeConfig(
        success_script="message := 'yes'",
        failure_script="message := 'no'",
        post_script="after := message",
        async_delay=10,
    )
    tree = load_test_node(settings)
    tree.tick_once()
    assert "message" not in tree.blackboard
    assert tree.tick_while_running() is Status.SUCCESS
    assert (tree.blackboard["message"], tree.blackboard["after"]) == ("yes", "yes")


def test_failure_runs_the_failure_script() -> None:
    settings = TestNodeConfig(
        Status.FAILURE, success_script="message := 'yes'", failure_script="message := 'no'"
    )
    tree = load_test_node(settings)
    tree.tick_once()
    assert tree.blackboard["message"] == "no"


@pytest.mark.parametrize(
    ("script", "status"),
    [
        ("SUCCESS", Status.SUCCESS),
        ("FAILURE", Status.FAILURE),
        ("SKIPPED", Status.SKIPPED),
        ("'FAILURE'", Status.FAILURE),
        ("3", Status.FAILURE),
        ("level < 5 ? FAILURE : SUCCESS", Status.FAILURE),
    ],
)
def test_script_may_decide_the_result_issue_995(script: str, status: Status) -> None:
    tree = load_test_node(TestNodeConfig(return_status_script=script))
    tree.blackboard["level"] = 4
    assert tree.tick_once() is status


@pytest.mark.parametrize("script", ["'MAYBE'", "7", "2.5"])
def test_script_result_that_is_not_a_status_raises(script: str) -> None:
    with pytest.raises(NodeExecutionError, match="IDLE, RUNNING, SUCCESS, FAILURE or SKIPPED"):
        load_test_node(TestNodeConfig(return_status_script=script)).tick_once()


def test_complete_func_decides_the_result_before_the_script() -> None:
    answers = iter([Status.RUNNING, Status.FAILURE])
    settings = TestNodeConfig(return_status_script="SUCCESS", complete_func=lambda: next(answers))
    tree = load_test_node(settings)
    assert [tree.tick_exactly_once(), tree.tick_exactly_once()] == [Status.RUNNING, Status.FAILURE]


def test_invalid_script_is_refused_and_named() -> None:
    with pytest.raises(TreeError, match=r"post_script of the TestNode for 'leaf'"):
        load_test_node(TestNodeConfig(post_script="a := := 1"))


def test_conditions_of_the_node_still_apply() -> None:
    tree = load_test_node(TestNodeConfig(return_status=Status.FAILURE), '_successIf="true" _post="done := 1"')
    assert tree.tick_once() is Status.SUCCESS
    assert tree.blackboard["done"] == 1


# --- JSON


def test_rules_are_loaded_from_json(nodes: Registry, tmp_path: Path) -> None:
    rules = {
        "TestNodeConfigs": {
            "slow": {"return_status": "SUCCESS", "async_delay": 2000, "post_script": "slept := 1"},
            "broken": {"return_status": "FAILURE", "failure_script": "tried := 1"},
            "asked": {"return_status_script": "tried == 1 ? SUCCESS : FAILURE", "success_script": "ok := 1"},
        },
        "SubstitutionRules": {"out": "broken", "back": "asked", "home": "slow", "Charged": "AlwaysSuccess"},
    }
    file = tmp_path / "rules.json"
    file.write_text(json.dumps(rules), encoding="utf-8")
    load_substitution_rules(nodes, file)
    board = Blackboard()
    tree = load(nodes, XML.replace('name="patrol"', 'name="patrol" _autoremap="true"'), board)
    assert tree.tick_while_running() is Status.SUCCESS
    assert tree.clock.now() == 2_000_000_000
    assert {key: board[key] for key in board} == {"tried": 1, "ok": 1, "slept": 1, "arrived": 1}


def test_rules_without_configurations_name_registered_nodes_issue_930(nodes: Registry) -> None:
    load_substitution_rules(
        nodes, '{"SubstitutionRules": {"Drive": "AlwaysFailure", "home": "AlwaysSuccess"}}'
    )
    assert load(nodes).tick_once() is Status.FAILURE


def test_a_configuration_may_have_the_name_of_a_registered_node_issue_927(nodes: Registry) -> None:
    load_substitution_rules(
        nodes,
        '{"TestNodeConfigs": {"AlwaysFailure": {"return_status": "SUCCESS"}}, "SubstitutionRules": '
        '{"Drive": "AlwaysFailure"}}',
    )
    assert load(nodes).tick_once() is Status.SUCCESS


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "are not valid JSON"),
        ("[]", "is [], and an object of keys and values is expected"),
        ("{}", "'SubstitutionRules' is missing"),
        (
            '{"SubstitutionRules": ["Drive"]}',
            "'SubstitutionRules' is [\"Drive\"], and an object of keys and values is expected",
        ),
        (
            '{"SubstitutionRules": {"Drive": 3}}',
            "'SubstitutionRules.Drive' is 3, and a text is expected",
        ),
        (
            '{"SubstitutionRules": {}, "TestNodeConfigs": {"a": {}}}',
            "'TestNodeConfigs.a' needs 'return_status'",
        ),
        (
            '{"SubstitutionRules": {}, "TestNodeConfigs": {"a": {"return_status": "IDLE"}}}',
            '"RUNNING", "SUCCESS", "FAILURE" or "SKIPPED" is expected',
        ),
        (
            '{"SubstitutionRules": {}, "TestNodeConfigs": {"a": {"return_status": "SUCCESS", "delay": 3}}}',
            "did you mean 'async_delay'",
        ),
        (
            '{"SubstitutionRules": {}, "TestNodeConfigs": {"a": {"return_status": "FAILURE", '
            '"async_delay": "3"}}}',
            "'TestNodeConfigs.a.async_delay' is \"3\", and a whole number is expected",
        ),
    ],
)
def test_errors_in_the_json_are_reported(nodes: Registry, text: str, message: str) -> None:
    with pytest.raises(SubstitutionError) as refused:
        load_substitution_rules(nodes, text)
    assert message in str(refused.value)
    assert list(nodes.substitutions) == ["Charged"]


def test_rules_that_are_not_utf_8_are_an_error(nodes: Registry, tmp_path: Path) -> None:
    file = tmp_path / "rules.json"
    file.write_bytes('{"SubstitutionRules": {"Tür": "AlwaysFailure"}}'.encode("latin-1"))
    with pytest.raises(SubstitutionError, match="the substitution rules are not text in UTF-8"):
        load_substitution_rules(nodes, file)
