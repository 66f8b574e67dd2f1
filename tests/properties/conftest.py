"""Settings of the property tests: random examples on a developer's machine, fixed examples in CI."""

import os

from hypothesis import HealthCheck, settings

settings.register_profile(
    "btcore", max_examples=100, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile(
    "btcore-ci", settings.get_profile("btcore"), max_examples=500, derandomize=True, database=None
)
settings.load_profile("btcore-ci" if os.environ.get("CI") else "btcore")
