"""The table of the modules that the extras install."""

import re
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from btcore.extras import EXTRA_OF, describe_missing, install_command

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]


# It reads the metadata of every installed distribution.
distributions_by_module = cache(packages_distributions)


@pytest.mark.parametrize("module", EXTRA_OF)
def test_extra_of_the_table_installs_the_module(module: str) -> None:
    distributions = distributions_by_module().get(module)
    if distributions is None:
        pytest.skip(f"{module} is not installed")
    required = requirements(EXTRA_OF[module])
    transitive = {"anyio": "mcp", "distributed": "dask", "lsprotocol": "pygls", "zstandard": "mcap"}
    assert {normalised(name) for name in (*distributions, transitive.get(module, ""))} & required


def requirements(extra: str) -> set[str]:
    """Return the names of the distributions that *extra* requires."""
    return {normalised(re.split(r"[^\w.-]", text)[0]) for text in PROJECT["optional-dependencies"][extra]}


def normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def test_hint_names_the_extra_of_a_submodule() -> None:
    assert install_command("rerun") == "pip install 'btcore[monitor]'"
    assert describe_missing("scipy.ndimage") == (
        "the module 'scipy.ndimage' is not installed; install it with: pip install 'btcore[robot]'"
    )


def test_module_that_no_extra_installs_has_no_command() -> None:
    assert describe_missing("arm_driver") == "the module 'arm_driver' is not installed"
