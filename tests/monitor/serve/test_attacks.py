"""Attacks on a publisher's ports, side by side with a robot that is not attacked."""

import os
import subprocess
import sys
from collections.abc import Callable
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def attacks(acceptance_script: Callable[[str], ModuleType]) -> ModuleType:
    """The acceptance script, which measures more attacks for longer."""
    return acceptance_script("attacks")


def test_memory_and_a_second_client_do_not_notice_endless_topics_and_unfinished_requests(
    attacks: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine may be silent for seconds, too.
    monkeypatch.setattr("btcore_monitor.watch.run_channel_feed.SILENT_AFTER_S", attacks.REPLY_WITHIN)
    attacked, _ = attacks.run_pair(["big_topics", "unfinished"], 1.0)
    assert not attacked.died
    assert attacked.growth <= attacks.GROWTH
    assert (attacked.received, attacked.unanswered, attacked.disconnected) == (attacked.transitions, 0, 0)
    assert attacked.ticks  # the script judges how many, over several runs: a busy computer loses some, too


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the script needs Linux")
def test_a_client_loses_nothing_under_attack_on_a_starved_machine(attacks: ModuleType) -> None:
    """The script in its own process, which lowers its priority."""
    short = ["--priority", "0", "--seconds", "0.5", "--attacks", "unfinished"]
    command = [sys.executable, attacks.__file__, "--starved", "1", *short]
    done = subprocess.run(command, capture_output=True, text=True, timeout=400, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
