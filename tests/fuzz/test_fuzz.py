"""A sample of the fuzzing that `make accept` runs at length: every input gives a result or a clean error."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="module")
def fuzz() -> ModuleType:
    path = Path(__file__).parents[1] / "acceptance" / "fuzz.py"
    spec = importlib.util.spec_from_file_location("acceptance_fuzz", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("kind", "count"), [("trees", 600), ("scripts", 1000), ("ports", 1000)])
def test_mutated_input_gives_a_result_or_a_clean_error(fuzz: ModuleType, kind: str, count: int) -> None:
    wrong = [line for line in fuzz.run(kind, 7, range(count))[1] if ": took " not in line]
    assert wrong == []
