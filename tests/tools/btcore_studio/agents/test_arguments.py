"""The settings of providers that are arguments of the tools of `btcore mcp`."""

import os
import subprocess
import sys

import pytest

pytest.importorskip("mcp", reason="the extra mcp is not installed")

import click
from pydantic import ValidationError

from btcore.entry_points import LIMIT_VARIABLE
from btcore.field_options import create_options
from btcore.runs.available_providers import AvailableProviders
from btcore_studio.agents.arguments import SETTINGS, RunArguments

OTHERS = {"tree", "xml", "tree_id", "models", "own_models", "outcomes", "entries", "duration", "until"}


def test_settings_of_agents_are_bounded_and_neither_files_nor_of_one_run() -> None:
    arguments = RunArguments.model_json_schema()["properties"]
    assert set(arguments) == {*SETTINGS, *OTHERS}
    [simulator] = AvailableProviders().of_type("btcore_sim.simulated_robot.SimulatedRobot")
    options = [option for cls in simulator.settings_classes for option in create_options(cls)]
    for option in options:
        if option.name in SETTINGS:
            assert not option.one_run_only
            assert not isinstance(option.type, click.Path)
    for name in SETTINGS:
        schema = arguments[name]
        schema = schema.get("anyOf", [schema])[0]  # the other is null
        if schema["type"] == "array":
            assert schema["maxItems"] == 20
            schema = schema["items"]
        if schema["type"] == "string":
            assert "pattern" in schema or schema["maxLength"] == 60
        else:
            assert {"minimum", "exclusiveMinimum"} & set(schema)
            assert "maximum" in schema


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["rate", "battery", "noise", "duration"])
def test_a_number_is_finite(name: str, number: float) -> None:
    with pytest.raises(ValidationError, match="finite number"):
        RunArguments.model_validate({name: number})


def test_without_the_simulator_its_settings_are_no_arguments() -> None:
    program = "from btcore_studio.agents.arguments import RunArguments; print(*RunArguments.model_fields)"
    environment = {**os.environ, LIMIT_VARIABLE: "mcp"}
    printed = subprocess.check_output([sys.executable, "-c", program], env=environment, text=True)
    assert set(printed.split()) == {*OTHERS, "rate", "seed"}
