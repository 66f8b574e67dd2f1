"""The site of static files, which `.ci/studio-site` builds and tests."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def site() -> Path:
    """The folder of the built site; the test is skipped without the environment variable BTCORE_SITE."""
    folder = os.environ.get("BTCORE_SITE")
    if not folder:
        pytest.skip("BTCORE_SITE is not set: .ci/studio-site")
    return Path(folder).resolve()
