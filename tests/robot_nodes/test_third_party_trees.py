"""Trees as readers of the book and users of Nav2 write them: they load unchanged and work.

They are in `third_party_trees`: with the book's node names and ports, subtrees of format 3, Groot's models,
and the tree that Nav2 came with in 2020.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

pytest.importorskip("pybullet")

from btcore import Registry
from btcore.cli.main import main
from btcore.lint.validate import validate_document
from btcore.xml.read.read import parse_file

FOLDER = Path(__file__).parent / "third_party_trees"
GIVEN = ("goal", "goals", "low")


def btcore_run(name: str, *options: str) -> Result:
    arguments = ["run", name, "--camera", "off", "--fast", *options]
    done = CliRunner().invoke(main, arguments, prog_name="btcore")
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr
    return done


def run(name: str, *options: str) -> dict[str, Any]:
    done = btcore_run(str(FOLDER / name), "--json", *options)
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    assert result["robot"]["collisions"] == 0
    return result


def ids(result: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the results of the nodes by ID; of several nodes with the same ID, the last."""
    return {node["id"]: node for node in result["nodes"].values()}


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.xml")), ids=lambda path: path.stem)
def test_third_party_trees_have_no_diagnostics(path: Path) -> None:
    nodes = Registry.standard()
    assert nodes.add_installed_libraries() == []
    nodes.add_plugin(FOLDER / "nod.py")
    assert validate_document(parse_file(path), nodes=nodes, given=GIVEN) == []


def test_the_patrol_of_the_books_text_ends_after_one_waypoint() -> None:
    # Its figure has no KeepRunningUntilFailure, and calls conditions actions.
    result = run("patrol_of_the_text.xml", "--world", "aws_house", "--duration", "60")
    assert result["status"] == "SUCCESS"
    assert result["robot"]["waypoints_visited"] == ["wp1"]
    assert ids(result)["Patrol"]["ticks"] == 151


def test_a_patrol_in_subtrees_recharges_below_its_own_threshold() -> None:
    # low="{low}", and SubTreePlus with constants: a threshold of 99 forces a recharge after any distance.
    result = run("patrol_in_subtrees.xml", "--world", "house", "--duration", "48", "--set", "low=99")
    assert result["status"] == "RUNNING"
    assert result["robot"]["recharges"] >= 1
    assert ids(result)["TrackObjects"]["halted"] >= 1


def test_a_subtree_with_remapped_goals_visits_them_and_has_a_timeout() -> None:
    result = run("round_of_visits.xml", "--world", "aws_house", "--duration", "100")
    assert result["robot"]["waypoints_visited"][:3] == ["wp1", "wp2", "wp3"]
    assert ids(result)["Timeout"]["failure"] >= 1


def test_a_reactive_fallback_interrupts_the_manoeuvre_as_the_book_warns() -> None:
    # The book's Fallback remembers its running child; with ReactiveFallback the robot never gets to turn.
    result = run("reactive_escape.xml", "--duration", "15")
    assert ids(result)["Back"]["halted"] > 10
    assert ids(result)["Turn"]["ticks"] == 0


def test_nav2s_tree_of_2020_drives_to_its_goal() -> None:
    result = run("navigate_of_2020.xml", "--world", "house", "--duration", "60", "--set", "goal=0.7;-3.5")
    assert result["status"] == "SUCCESS"
    assert result["robot"]["pose"]["y"] == pytest.approx(-3.5, abs=0.3)


def test_the_navigator_accepts_a_third_party_tree_and_its_nodes(tmp_path: Path) -> None:
    parameters = tmp_path / "nav.yaml"
    parameters.write_text(
        "bt_navigator:\n  ros__parameters:\n"
        f"    default_nav_to_pose_bt_xml: {FOLDER / 'navigate_and_nod.xml'}\n"
        "    plugin_lib_names:\n"
        "    - nav2_compute_path_to_pose_action_bt_node\n"
        f"    - {FOLDER / 'nod.py'}\n"
    )
    tree = tmp_path / "go.xml"
    tree.write_text(
        '<root main_tree_to_execute="Go"><BehaviorTree ID="Go"><Move goal="1;0.3"/></BehaviorTree></root>'
    )
    result = run(str(tree), "--world", "house", "--duration", "40", "--nav-params", str(parameters))
    assert result["status"] == "SUCCESS"


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("plugin_lib_names: [no_such_library]", "plugin 'no_such_library'"),
        ("default_nav_to_pose_bt_xml: nowhere.xml", "there is no tree nowhere.xml: navigate_to_pose_w_"),
    ],
)
def test_missing_plugin_or_tree_in_parameters_is_reported(tmp_path: Path, line: str, message: str) -> None:
    parameters = tmp_path / "nav.yaml"
    parameters.write_text(f"bt_navigator:\n  ros__parameters:\n    {line}\n")
    options = ["--world", "house", "--duration", "0.2", "--nav-params", str(parameters)]
    assert message in btcore_run("patrolling", *options).stderr
