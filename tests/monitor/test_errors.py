"""Every exception of the package derives from its base class, so that a single handler catches all."""

import importlib
import pkgutil

import btcore_monitor
from btcore_monitor.errors import MonitorError


def test_every_exception_that_the_package_defines_derives_from_monitor_error() -> None:
    names = [
        module.name
        for module in pkgutil.walk_packages(btcore_monitor.__path__, "btcore_monitor.")
        if not module.name.endswith("__main__")
    ]
    exceptions = {
        value
        for name in names
        for value in vars(importlib.import_module(name)).values()
        if isinstance(value, type) and issubclass(value, Exception) and value.__module__ in names
    }
    assert len(exceptions) > 10
    assert [cls.__qualname__ for cls in exceptions if not issubclass(cls, MonitorError)] == []
    assert [cls.__qualname__ for cls in exceptions if not cls.__name__.endswith("Error")] == []
