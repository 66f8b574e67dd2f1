"""Behavior trees written for BehaviorTree.CPP, run in Python."""

# ruff: noqa: E402 - which build the other modules come from has to be chosen first
from btcore import builds

builds.select_build()

from btcore import values
from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.ports import Direction, Port
from btcore.clock import Clock, SimClock, SystemClock
from btcore.engine.context import TreeState
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.coroutine import running, sleep
from btcore.engine.functions import action, condition
from btcore.engine.leaf import Condition, StatefulAction, SyncAction
from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer, Transitions
from btcore.engine.signature import (
    In,
    InOut,
    Out,
    Put,
)
from btcore.engine.threaded import ThreadedAction
from btcore.errors import (
    BlackboardError,
    BtcoreError,
    ConversionError,
    Diagnostic,
    NodeError,
    NodeExecutionError,
    PortError,
    RegistrationError,
    ScriptError,
    TreeError,
    UnknownNodeError,
    XmlSyntaxError,
)
from btcore.loading.load import load, loads, required_resources
from btcore.registry.registry import Registry
from btcore.script.program import compile_script
from btcore.status import NodeType, Status, Transition
from btcore.tree.tree import Subtree, Tree
from btcore.xml.builder import Builder, blackboard_key

builds.describe(Direction, NodeType, Status, Transition)

__all__ = [
    "Blackboard",
    "BlackboardError",
    "BtcoreError",
    "Builder",
    "Clock",
    "Condition",
    "ControlNode",
    "ConversionError",
    "DecoratorNode",
    "Diagnostic",
    "Direction",
    "Entry",
    "In",
    "InOut",
    "NodeError",
    "NodeExecutionError",
    "NodeType",
    "Observer",
    "Out",
    "Port",
    "PortError",
    "Put",
    "RegistrationError",
    "Registry",
    "ScriptError",
    "SimClock",
    "StatefulAction",
    "Status",
    "Subtree",
    "SyncAction",
    "SystemClock",
    "ThreadedAction",
    "Transition",
    "Transitions",
    "Tree",
    "TreeError",
    "TreeNode",
    "TreeState",
    "UnknownNodeError",
    "XmlSyntaxError",
    "action",
    "blackboard_key",
    "builds",
    "compile_script",
    "condition",
    "load",
    "loads",
    "required_resources",
    "running",
    "sleep",
    "values",
]
