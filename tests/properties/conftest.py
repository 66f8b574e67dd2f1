"""In CI, properties are tested with more examples, most of them on the compiled build, which is faster."""

import os
from collections.abc import Generator

import pytest
from hypothesis import settings

from btcore import builds

PROFILE = "ci" if os.environ.get("CI") else "local"
# test_builds_agree.py compares the builds, so that the pure build needs fewer examples.
EXAMPLES = 200 if builds.active_build() == "compiled" else 50
settings.register_profile("ci-properties", settings.get_profile("ci"), max_examples=EXAMPLES)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, object, object]:
    """Import the modules of this folder with their own settings, which tests keep."""
    if PROFILE == "ci":
        settings.load_profile("ci-properties")
    try:
        return (yield)
    finally:
        settings.load_profile(PROFILE)
