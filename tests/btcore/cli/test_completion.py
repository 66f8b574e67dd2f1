"""Shell completion: of trees, their IDs, worlds and nodes."""

from pathlib import Path

import pytest
from click.shell_completion import ShellComplete

from btcore.cli.main import main


@pytest.mark.parametrize(
    ("words", "incomplete", "expected"),
    [
        (["run"], "bump", ["bumpgo", "bumpgo_wide"]),
        (["run"], "", ["tree.xml", "bumpgo"]),
        (["validate"], "tre", ["tre"]),
        (["run", "tree.xml", "--tree"], "", ["Main", "Other"]),
        (["show", "tree.xml", "--tree"], "O", ["Other"]),
        (["show", "missing.xml", "--tree"], "", []),
        (["run", "bumpgo", "--world"], "ar", ["arena", "arena_boxes"]),
        (["map"], "hou", ["house"]),
        (["nodes"], "Repe", ["Repeat"]),
        (["run"], "--tick", ["--tick-limit"]),
        ([], "sho", ["show"]),
    ],
)
def test_shell_completes_names(
    words: list[str], incomplete: str, expected: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    trees = "".join(
        f'<BehaviorTree ID="{tree}"><AlwaysSuccess/></BehaviorTree>' for tree in ("Main", "Other")
    )
    Path("tree.xml").write_text(f'<root BTCPP_format="4" main_tree_to_execute="Main">{trees}</root>')
    shell = ShellComplete(main, {}, "btcore", "_BTCORE_COMPLETE")
    found = [item.value for item in shell.get_completions(words, incomplete)]
    assert found[: len(expected)] == expected
    assert incomplete == "" or len(found) == len(expected)
