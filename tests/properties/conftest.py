"""In CI, properties are tested with more examples: some faults need more than a hundred."""

import os
from collections.abc import Generator

import pytest
from hypothesis import settings

PROFILE = "ci" if os.environ.get("CI") else "local"
settings.register_profile("ci-properties", settings.get_profile("ci"), max_examples=500)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, object, object]:
    """Import the modules of this folder with their own settings, which tests keep."""
    if PROFILE == "ci":
        settings.load_profile("ci-properties")
    try:
        return (yield)
    finally:
        settings.load_profile(PROFILE)
