"""Which build runs, and how to choose it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from btcore import builds


def build_of_a_new_process(**environment: str) -> str:
    program = "from btcore import builds, node; print(builds.running(), node.__file__)"
    inherited = {key: value for key, value in os.environ.items() if key != "BTCORE_PURE"}
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=inherited | environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


@pytest.mark.skipif("BTCORE_EXPECT" not in os.environ, reason="BTCORE_EXPECT names no build to expect")
def test_the_build_under_test_is_the_one_that_is_meant_to_be() -> None:
    assert builds.running() == os.environ["BTCORE_EXPECT"]


def test_btcore_pure_takes_the_source_of_any_install() -> None:
    build, file = build_of_a_new_process(BTCORE_PURE="1").split()
    assert build == "pure"
    assert Path(file).parts[-2:] == ("btcore", "node.py")


def test_btcore_pure_set_to_nothing_or_0_changes_nothing() -> None:
    as_installed = build_of_a_new_process()
    assert build_of_a_new_process(BTCORE_PURE="") == as_installed
    assert build_of_a_new_process(BTCORE_PURE="0") == as_installed
