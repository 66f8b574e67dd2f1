"""Episodes, as a worker process runs them."""

import logging
from pathlib import Path

import pytest

from btcore_sweep.episode import run_episode

PLUGIN = """
import logging
from collections.abc import Iterator
from typing import Annotated
from btcore import Report, Settings, action, option, provider

class ChargerSettings(Settings):
    charger: Annotated[int, option("The number of the charger.", metavar="N")] = 0

@provider
def charger(settings: ChargerSettings, report: Report) -> Iterator[None]:
    yield
    report.warn("the charger is off")

@action
def complain() -> bool:
    logging.getLogger("leaves").warning("too dark\\nfor a picture")
    return True
"""


def test_an_episode_returns_the_warnings_of_the_command_of_leaves_and_of_providers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # those of pytest
    (tmp_path / "plugin.py").write_text(PLUGIN)
    (tmp_path / "tree.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Sequence><Complain/><Complain/></Sequence>'
        "</BehaviorTree></root>"
    )
    command = ["tree.xml", "--fast", "--plugin", "plugin.py", "--charger", "1", "--set", "laps=1"]
    result = run_episode(command, str(tmp_path))
    assert result["code"] == 0, result
    assert result["warnings"] == [
        "--set laps: no port or script of the tree uses 'laps'",
        "too dark",
        "the charger is off",
    ]
