"""A sample of the fuzzing that `make accept` runs at length: every input gives a result or a clean error."""

from collections.abc import Callable
from types import ModuleType

import pytest
from hypothesis import settings


@pytest.fixture(scope="module")
def fuzz(acceptance_script: Callable[[str], ModuleType]) -> ModuleType:
    return acceptance_script("fuzz")


@pytest.mark.parametrize(("kind", "times"), [("trees", 6), ("scripts", 10), ("ports", 10)])
def test_mutated_input_gives_a_result_or_a_clean_error(fuzz: ModuleType, kind: str, times: int) -> None:
    count = times * settings().max_examples
    wrong = [line for line in fuzz.run(kind, 7, range(count))[1] if ": took " not in line]
    assert wrong == []
