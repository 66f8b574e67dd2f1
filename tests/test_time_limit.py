"""A test that exceeds the time limit fails, and the run of all tests goes on."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ENVIRONMENT = {
    "BTCORE_TEST_TIME_LIMIT": "1",
    "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",  # the other plugins take longer to import than these tests
    "PYTEST_PLUGINS": "xdist.plugin",
}
HANGING = """
import multiprocessing
import time

import pytest

@pytest.mark.parametrize("number", range(4))
def test_it(number, request):
    if number == 1:
        # A copy of the worker, which holds the connection to pytest-xdist open.
        copy = multiprocessing.get_context("fork").Process(target=time.sleep, args=(1000,))
        copy.start()
        request.addfinalizer(copy.kill)
        time.sleep(1000)

@pytest.fixture
def slow():
    yield
    time.sleep(1000)

def test_with_a_fixture_that_hangs(slow):
    pass
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGALRM")
def test_test_that_hangs_fails_and_the_run_goes_on(tmp_path: Path) -> None:
    shutil.copy(Path(__file__).with_name("conftest.py"), tmp_path)
    (tmp_path / "test_it.py").write_text(HANGING, encoding="utf-8")
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-n2", "--dist", "worksteal", "-p", "no:cacheprovider"),
            *("-W", "ignore:This process:DeprecationWarning"),  # a fork with threads, from Python 3.12 on
        ],
        cwd=tmp_path,
        env=os.environ | ENVIRONMENT,
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == 1
    assert "1 failed, 4 passed, 1 error" in done.stdout
    assert done.stdout.count("Failed: the test has exceeded the time limit of 1 s") >= 2
