"""Run behavior trees that were written for BehaviorTree.CPP, in Python.

A public name is imported from its module when it is first used, so that a small program imports only the
modules that it needs.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from btcore import builds

builds.select_build(__name__)

# For type checkers. `_HOMES` lists the same names: tests/test_architecture.py compares the lists.
if TYPE_CHECKING:
    __version__: str

    from btcore.blackboard.blackboard import Blackboard as Blackboard
    from btcore.blackboard.blackboard import Entry as Entry
    from btcore.blackboard.ports import Direction as Direction
    from btcore.blackboard.ports import Port as Port
    from btcore.clock import Clock as Clock
    from btcore.clock import SimClock as SimClock
    from btcore.clock import SystemClock as SystemClock
    from btcore.diagnostics import Diagnostic as Diagnostic
    from btcore.diagnostics import LiteralProblem as LiteralProblem
    from btcore.engine.control import ControlNode as ControlNode
    from btcore.engine.control import DecoratorNode as DecoratorNode
    from btcore.engine.coroutine import running as running
    from btcore.engine.coroutine import sleep as sleep
    from btcore.engine.functions import action as action
    from btcore.engine.functions import condition as condition
    from btcore.engine.leaf import Condition as Condition
    from btcore.engine.leaf import StatefulAction as StatefulAction
    from btcore.engine.leaf import SyncAction as SyncAction
    from btcore.engine.node import TreeNode as TreeNode
    from btcore.engine.node_spec import NodeSpec as NodeSpec
    from btcore.engine.observers import Observer as Observer
    from btcore.engine.signature import In as In
    from btcore.engine.signature import InOut as InOut
    from btcore.engine.signature import Out as Out
    from btcore.engine.signature import Put as Put
    from btcore.engine.threaded import ThreadedAction as ThreadedAction
    from btcore.engine.transition_records import Transitions as Transitions
    from btcore.errors import BlackboardError as BlackboardError
    from btcore.errors import BtcoreError as BtcoreError
    from btcore.errors import ConversionError as ConversionError
    from btcore.errors import NodeError as NodeError
    from btcore.errors import NodeExecutionError as NodeExecutionError
    from btcore.errors import OutputError as OutputError
    from btcore.errors import PortError as PortError
    from btcore.errors import ProviderError as ProviderError
    from btcore.errors import RegistrationError as RegistrationError
    from btcore.errors import ScriptError as ScriptError
    from btcore.errors import SettingsError as SettingsError
    from btcore.errors import TreeError as TreeError
    from btcore.errors import UnknownNodeError as UnknownNodeError
    from btcore.errors import XmlSyntaxError as XmlSyntaxError
    from btcore.loading.builder import Builder as Builder
    from btcore.loading.builder import blackboard_key as blackboard_key
    from btcore.loading.load import load as load
    from btcore.loading.load import loads as loads
    from btcore.loading.load import make as make
    from btcore.nodes.loop import LoopNode as LoopNode
    from btcore.options import option as option
    from btcore.registry.registry import Registry as Registry
    from btcore.registry.resources import Resources as Resources
    from btcore.registry.resources import TreeResource as TreeResource
    from btcore.runs.providers import provider as provider
    from btcore.runs.report import Report as Report
    from btcore.runs.run import Run as Run
    from btcore.runs.settings import RunSettings as RunSettings
    from btcore.runs.settings import Settings as Settings
    from btcore.script.program import compile_script as compile_script
    from btcore.status import FAILURE as FAILURE
    from btcore.status import IDLE as IDLE
    from btcore.status import RUNNING as RUNNING
    from btcore.status import SKIPPED as SKIPPED
    from btcore.status import SUCCESS as SUCCESS
    from btcore.status import NodeType as NodeType
    from btcore.status import Status as Status
    from btcore.status import Transition as Transition
    from btcore.tree.tree import Subtree as Subtree
    from btcore.tree.tree import Tree as Tree

_HOMES = {
    "btcore.blackboard.blackboard": ("Blackboard", "Entry"),
    "btcore.blackboard.ports": ("Direction", "Port"),
    "btcore.clock": ("Clock", "SimClock", "SystemClock"),
    "btcore.diagnostics": ("Diagnostic", "LiteralProblem"),
    "btcore.engine.control": ("ControlNode", "DecoratorNode"),
    "btcore.engine.coroutine": ("running", "sleep"),
    "btcore.engine.functions": ("action", "condition"),
    "btcore.engine.leaf": ("Condition", "StatefulAction", "SyncAction"),
    "btcore.engine.node": ("TreeNode",),
    "btcore.engine.node_spec": ("NodeSpec",),
    "btcore.engine.observers": ("Observer",),
    "btcore.engine.signature": ("In", "InOut", "Out", "Put"),
    "btcore.engine.threaded": ("ThreadedAction",),
    "btcore.engine.transition_records": ("Transitions",),
    "btcore.errors": (
        "BlackboardError", "BtcoreError", "ConversionError", "NodeError",
        "NodeExecutionError", "OutputError", "PortError", "ProviderError", "RegistrationError",
        "ScriptError", "SettingsError", "TreeError", "UnknownNodeError", "XmlSyntaxError",
    ),
    "btcore.loading.builder": ("Builder", "blackboard_key"),
    "btcore.loading.load": ("load", "loads", "make"),
    "btcore.nodes.loop": ("LoopNode",),
    "btcore.options": ("option",),
    "btcore.registry.resources": ("Resources", "TreeResource"),
    "btcore.registry.registry": ("Registry",),
    "btcore.runs.providers": ("provider",),
    "btcore.runs.report": ("Report",),
    "btcore.runs.run": ("Run",),
    "btcore.runs.settings": ("RunSettings", "Settings"),
    "btcore.script.program": ("compile_script",),
    "btcore.status": (
        "FAILURE", "IDLE", "RUNNING", "SKIPPED", "SUCCESS", "NodeType", "Status", "Transition",
    ),
    "btcore.tree.tree": ("Subtree", "Tree"),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [*_MODULE_OF, "builds", "values"]  # with the public submodules


def __getattr__(name: str) -> object:
    """Import the public name *name*, or the submodule of that name."""
    if name == "__version__":
        value: object = _installed_version()
    elif name in _MODULE_OF:
        value = getattr(import_module(_MODULE_OF[name]), name)
    elif name in __all__:
        value = import_module(f"btcore.{name}")
    else:
        raise AttributeError(f"module 'btcore' has no attribute {name!r}")
    globals()[name] = value
    return value


def _installed_version() -> str:
    from importlib.metadata import PackageNotFoundError, version  # takes longer than importing btcore

    try:
        return version("btcore")
    except PackageNotFoundError:
        return "0+unknown"


def __dir__() -> list[str]:
    """Return the public names, including those that are not imported yet."""
    return sorted({*globals(), *__all__})
