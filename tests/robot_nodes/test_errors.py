"""The exceptions of ``btcore_robot``: they have a common base class."""

import inspect
from importlib import import_module
from pkgutil import walk_packages

import btcore_robot
from btcore_robot.errors import RobotError


def test_every_exception_derives_from_robot_error() -> None:
    modules = [import_module(found.name) for found in walk_packages(btcore_robot.__path__, "btcore_robot.")]
    exceptions = {
        kind
        for module in modules
        for _, kind in inspect.getmembers(module, inspect.isclass)
        if issubclass(kind, BaseException) and kind.__module__.startswith("btcore_robot.")
    }
    assert len(exceptions) > 10
    assert all(issubclass(kind, RobotError) for kind in exceptions)
