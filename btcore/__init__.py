"""Behavior trees written for BehaviorTree.CPP, run in Python."""

# ruff: noqa: E402 - which build the other modules come from has to be chosen first
from btcore import builds

builds.choose()

from btcore import values
from btcore.blackboard import Blackboard, Entry
from btcore.clock import Clock, SimClock, SystemClock
from btcore.context import TreeState
from btcore.coroutine import running, sleep
from btcore.errors import (
    BlackboardFault,
    BtcoreError,
    ConversionFault,
    Diagnostic,
    NodeFault,
    NodeRaised,
    PortFault,
    RegistrationError,
    ScriptFault,
    SyntaxFault,
    TreeError,
    UnknownNode,
)
from btcore.functions import action, condition
from btcore.inner import ControlNode, DecoratorNode
from btcore.leaf import Condition, StatefulAction, SyncAction
from btcore.loading import load, loads, wanted
from btcore.node import TreeNode
from btcore.observers import Observer, Transitions
from btcore.ports import Direction, Port
from btcore.registry import Registry
from btcore.script.program import compile_script
from btcore.signature import In, InOut, Out, Put
from btcore.status import NodeType, Status, Transition
from btcore.threaded import ThreadedAction
from btcore.tree import Subtree, Tree
from btcore.xml.compose import Builder, key

builds.describe(Direction, NodeType, Status, Transition)

__all__ = [
    "Blackboard",
    "BlackboardFault",
    "BtcoreError",
    "Builder",
    "Clock",
    "Condition",
    "ControlNode",
    "ConversionFault",
    "DecoratorNode",
    "Diagnostic",
    "Direction",
    "Entry",
    "In",
    "InOut",
    "NodeFault",
    "NodeRaised",
    "NodeType",
    "Observer",
    "Out",
    "Port",
    "PortFault",
    "Put",
    "RegistrationError",
    "Registry",
    "ScriptFault",
    "SimClock",
    "StatefulAction",
    "Status",
    "Subtree",
    "SyncAction",
    "SyntaxFault",
    "SystemClock",
    "ThreadedAction",
    "Transition",
    "Transitions",
    "Tree",
    "TreeError",
    "TreeNode",
    "TreeState",
    "UnknownNode",
    "action",
    "builds",
    "compile_script",
    "condition",
    "key",
    "load",
    "loads",
    "running",
    "sleep",
    "values",
    "wanted",
]
