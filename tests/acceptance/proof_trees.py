"""Random trees of at most four leaves, with random questions, for the acceptance run of `btcore prove`.

The trees contain every built-in control node and decorator of both formats, some also decorators of users.
Each leaf has a kind, from which the model leaves of the prover and the scripted leaves of the plain
enumeration are made separately.
"""

import random
import re
from collections.abc import Callable
from itertools import count
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

from proof_plugins import DECLARED, HIDDEN, HIDDEN_TAGS, UNIT_MS

from btcore.blackboard.ports import LOAD_TIME_ROLES, Direction, Port, PortRole
from btcore.lint.ports import is_required
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.values import INT, STRING

MOST_LEAVES = 4
DOMAINS = {"m": ("0", "1"), "s": ("0", "1")}
"""The values of the entries that leaves write. The values of u and w are not known to the prover."""


class LeafKind(NamedTuple):
    """What a leaf may do.

    Attributes:
        base: `condition`, `sync` or `action`.
        results: The letters of the results: S, F, K (SKIPPED) and R (RUNNING).
        is_late: Whether the first tick of the leaf is RUNNING.
        is_endless: Whether the leaf may be RUNNING forever.
        uses: The resource of the leaf, or "".
        port: The port `value`; None = no port.
        key: The entry of the port.
    """

    base: str
    results: str
    is_late: bool = False
    is_endless: bool = False
    uses: str = ""
    port: Port | None = None
    key: str = "m"


LEAVES = {
    "Check": LeafKind("condition", "SF"),
    "Do": LeafKind("sync", "SF", uses="base"),
    "Act": LeafKind("action", "SFR", uses="arm"),
    "Move": LeafKind("action", "SFR", is_late=True, uses="base"),
    "Turn": LeafKind("action", "SFR", uses="base"),
    "Dock": LeafKind("action", "SR", uses="base"),
    "Watch": LeafKind("action", "FR", is_endless=True),
    "Pass": LeafKind("sync", "SK"),
    "Sense": LeafKind("sync", "SF", port=Port("value", Direction.OUT, type=INT)),
    "Say": LeafKind("sync", "SF", port=Port("value", Direction.OUT, type=STRING), key="s"),
    "Note": LeafKind("sync", "SF", port=Port("value", Direction.OUT, type=INT), key="u"),
    "Tell": LeafKind("sync", "SF", port=Port("value", Direction.OUT, type=STRING), key="w"),
    "Use": LeafKind("sync", "SF", port=Port("value", Direction.IN, type=INT)),
}
_FORMAT_4_LEAVES = ("Pass",)
_ACTIONS = ("Act", "Move", "Turn", "Dock")

Attributes = dict[str, str]
_Maker = Callable[[random.Random, int], Attributes]


def _none(rng: random.Random, children: int) -> Attributes:
    return {}


def _fixed(**texts: str) -> _Maker:
    return lambda rng, children: dict(texts)


def _switch(rng: random.Random, children: int) -> Attributes:
    cases = {f"case_{number}": str(number - 1) for number in range(1, children)}
    return {"variable": rng.choice(["{s}", "{s}", "{w}"]), **cases}


def _cycles(rng: random.Random, children: int) -> Attributes:
    return {"num_cycles": rng.choice(["1", "2", "3", "-1"])}


def _attempts(rng: random.Random, children: int) -> Attributes:
    return {"num_attempts": rng.choice(["1", "2", "3", "-1"])}


def _duration(name: str) -> _Maker:
    return lambda rng, children: {name: str(UNIT_MS * rng.choice([0, 1, 1, 2, 2, 3]))}


def _parallel(rng: random.Random, children: int) -> Attributes:
    needed = rng.choice([-1, *range(1, children + 1)])
    return {"success_count": str(needed), "failure_count": str(rng.randint(1, children))}


def _parallel_3(rng: random.Random, children: int) -> Attributes:
    return {
        "success_threshold": str(rng.randint(1, children)),
        "failure_threshold": str(rng.randint(1, children)),
    }


def _flag(name: str) -> _Maker:
    return lambda rng, children: {name: rng.choice(["true", "false"])}


def _precondition(rng: random.Random, children: int) -> Attributes:
    results = ["SUCCESS", "FAILURE", "SKIPPED", "RUNNING"]
    return {"if": rng.choice(_CONDITIONS), "else": rng.choice(results)}


def _loop(values: str, key: str) -> _Maker:
    return lambda rng, children: {
        "queue": rng.choice([values, values, "{q}"]),
        "value": "{" + key + "}",
        "if_empty": rng.choice(["SUCCESS", "FAILURE", "SKIPPED"]),
    }


def _watched(rng: random.Random, children: int = 0) -> Attributes:
    return {"entry": rng.choice(["{m}", "{u}"])}


def _comparison(rng: random.Random, children: int) -> Attributes:
    status = rng.choice(["SUCCESS", "FAILURE", "RUNNING"])
    return {"value_A": rng.choice(["{a}", "{m}"]), "value_B": "1", "return_on_mismatch": status}


class NodeKind(NamedTuple):
    """A node with children: the least and greatest number of children, and a maker of its attributes."""

    least: int
    most: int
    attributes: _Maker = _none


_SHARED = {
    "Fallback": NodeKind(1, 4),
    "Sequence": NodeKind(1, 4),
    "ReactiveFallback": NodeKind(1, 4),
    "ReactiveSequence": NodeKind(1, 4),
    "IfThenElse": NodeKind(2, 3),
    **{f"Switch{number}": NodeKind(number + 1, number + 1, _switch) for number in range(2, 7)},
    "Delay": NodeKind(1, 1, _duration("delay_msec")),
    "Timeout": NodeKind(1, 1, _duration("msec")),
    "ForceFailure": NodeKind(1, 1),
    "ForceSuccess": NodeKind(1, 1),
    "Inverter": NodeKind(1, 1),
    "KeepRunningUntilFailure": NodeKind(1, 1),
}
NODES: dict[int, dict[str, NodeKind]] = {
    4: {
        **_SHARED,
        "AsyncFallback": NodeKind(1, 4),
        "AsyncSequence": NodeKind(1, 4),
        "SequenceWithMemory": NodeKind(1, 4),
        "Parallel": NodeKind(1, 4, _parallel),
        "ParallelAll": NodeKind(1, 4, lambda rng, n: {"max_failures": str(rng.randint(1, n))}),
        "TryCatch": NodeKind(2, 4, _flag("catch_on_halt")),
        "WhileDoElse": NodeKind(2, 3),
        "LoopBool": NodeKind(1, 1, _loop("true;false", "f")),
        "LoopDouble": NodeKind(1, 1, _loop("0.5;1.5", "d")),
        "LoopInt": NodeKind(1, 1, _loop("1;0", "a")),
        "LoopString": NodeKind(1, 1, _loop("1;0", "s")),
        "Precondition": NodeKind(1, 1, _precondition),
        "Repeat": NodeKind(1, 1, _cycles),
        "RetryUntilSuccessful": NodeKind(1, 1, _attempts),
        "RunOnce": NodeKind(1, 1, _flag("then_skip")),
        "SkipUnlessUpdated": NodeKind(1, 1, _watched),
        "WaitValueUpdate": NodeKind(1, 1, _watched),
    },
    3: {
        **_SHARED,
        "SequenceStar": NodeKind(1, 4),
        "ManualSelector": NodeKind(1, 3, _flag("repeat_last_selection")),
        "Parallel": NodeKind(1, 4, _parallel_3),
        "WhileDoElse": NodeKind(3, 3),
        # All cycles happen in one tick, so that -1 would make some ticks endless.
        "Repeat": NodeKind(1, 1, _fixed(num_cycles="2")),
        **dict.fromkeys(
            ("RetryUntilSuccessful", "RetryUntilSuccesful"), NodeKind(1, 1, _fixed(num_attempts="2"))
        ),
        **{f"BlackboardCheck{kind}": NodeKind(1, 1, _comparison) for kind in ("Bool", "Double", "Int")},
        "BlackboardCheckString": NodeKind(1, 1, _comparison),
    },
}
_USER_NODES = {
    **{cls.__name__: NodeKind(1, 1) for cls in (*DECLARED, *HIDDEN)},
    "UserTimer": NodeKind(1, 1, _duration("msec")),
    **dict.fromkeys(["UserCatch", "UserKeeps", "UserWrites"], NodeKind(1, 1, _fixed(value="{u}"))),
}
MOST_TIMERS = 2
_CONDITIONS = ("@a == 0", "@a == 1", "@b == @a", "1 / @z < 0", "@z == @z", "@u > 0", "@a == 1 && @u != 1")
_STATEMENTS = (
    *("@a := 1", "@a := 0", "@b := @a", "@a := 1 - @a"),
    *("@z := 0.0", "@z := 0.0 * -1", "@z := 0.0 / 0.0"),
    *("@a := @u > 0 ? 1 : 0", "@b := @u == 0"),
)
_WORD = re.compile(r"\w+")
_FILLERS = ("AlwaysSuccess", "AlwaysFailure")
_BUILT_IN: dict[int, dict[str, Callable[[random.Random], Attributes]]] = {
    4: {
        "Script": lambda rng: {"code": rng.choice(_STATEMENTS)},
        "ScriptCondition": lambda rng: {"code": rng.choice(_CONDITIONS)},
        "SetBlackboard": lambda rng: {"value": rng.choice("01"), "output_key": "{m}"},
        "UnsetBlackboard": lambda rng: {"key": "m"},
        "WasEntryUpdated": _watched,
        "Sleep": lambda rng: {"msec": str(UNIT_MS * rng.choice([0, 1, 2]))},
        "AlwaysSuccess": lambda rng: {},
        "AlwaysFailure": lambda rng: {},
    },
    3: {
        "SetBlackboard": lambda rng: {"value": rng.choice("01"), "output_key": "m"},
        "AlwaysSuccess": lambda rng: {},
        "AlwaysFailure": lambda rng: {},
    },
}


_TEXTS: dict[PortRole, Callable[[random.Random, int], str]] = {
    PortRole.CONDITION: lambda rng, children: rng.choice(_CONDITIONS),
    PortRole.SCRIPT: lambda rng, children: rng.choice(_STATEMENTS),
    PortRole.DURATION: lambda rng, children: str(UNIT_MS * rng.choice([0, 1, 2])),
    PortRole.REPETITIONS: lambda rng, children: rng.choice("123"),
    PortRole.SUCCESSES: lambda rng, children: str(rng.randint(1, children)),
    PortRole.FAILURES: lambda rng, children: str(rng.randint(1, children)),
}


def _derive_kind(manifest: Manifest) -> NodeKind | None:
    """Return how random trees contain a node; None if it has a mandatory port that needs a certain text."""
    roles = {port.name: port.role for port in manifest.ports.values() if is_required(manifest, port)}
    roles |= {port.name: port.role for port in manifest.ports.values() if port.role in LOAD_TIME_ROLES}
    if not _TEXTS.keys() >= set(roles.values()):
        return None

    def make(rng: random.Random, children: int) -> Attributes:
        return {name: _TEXTS[role](rng, children) for name, role in roles.items()}

    least, most = manifest.spec.child_count
    return NodeKind(max(least, 1), 4 if most is None else most, make)


_TIMED = ["Delay", "Timeout", "UserTimer"]


def _add_other_nodes() -> list[str]:
    """Add the built-in nodes that `NODES` does not list, and return those that must be listed there."""
    unknown = []
    for format, known in NODES.items():
        for id, manifest in Registry.standard().manifests_of(format).items():
            if manifest.type not in (NodeType.CONTROL, NodeType.DECORATOR) or id in known:
                continue
            kind = _derive_kind(manifest)
            if kind is None:
                unknown.append(f"{id} of format {format}")
                continue
            known[id] = kind
            if any(port.role is PortRole.DURATION for port in manifest.ports.values()):
                _TIMED.append(id)
    return unknown


UNKNOWN_NODES = _add_other_nodes()
"""The built-in control nodes and decorators that random trees never contain."""


class Atom(NamedTuple):
    """A proposition: a node is RUNNING, returned a status, was ticked or halted; or an entry has a value."""

    kind: str
    name: str
    value: str = ""

    def __str__(self) -> str:
        if self.kind == "entry":
            return f"{{{self.name}}} == {self.value}"
        return {
            "running": self.name,
            "is": f"{self.name} is {self.value}",
            "ticked": f"{self.name} ticked",
            "halted": f"{self.name} halted",
        }[self.kind]


class RandomQuestion(NamedTuple):
    """A question about a random tree; *second* is None for `never`. *within* is None without a limit."""

    kind: str
    first: Atom
    second: Atom | None = None
    within: int | None = None

    def __str__(self) -> str:
        if self.second is None:
            return f"never {self.first}"
        limit = "" if self.within is None else f" within {self.within} ticks"
        return f"{self.first} {self.kind} {self.second}{limit}"


class RandomTree(NamedTuple):
    """A random tree.

    Attributes:
        format: The XML format.
        xml: The document.
        tags: The tag of each node, by the node's name.
        attributes: The attributes of each node, by the node's name.
        questions: Random questions about the tree.
        is_instant: Whether its leaves take no time.
    """

    format: int
    xml: str
    tags: dict[str, str]
    attributes: dict[str, Attributes]
    questions: list[RandomQuestion]
    is_instant: bool = False

    @property
    def leaves(self) -> list[str]:
        """The names of the leaves that are not built in."""
        return [name for name, tag in self.tags.items() if tag in LEAVES]

    @property
    def compares_unknown(self) -> bool:
        """Whether a node or a question compares an entry whose value is not known to the prover."""
        texts = [text for attributes in self.attributes.values() for text in attributes.values()]
        switches = any(each.get("variable") == "{w}" for each in self.attributes.values())
        asked = any("{u}" in str(question) for question in self.questions)
        return asked or switches or any("@u" in text for text in texts)

    @property
    def is_hidden(self) -> bool:
        """Whether the tree has state that the prover cannot save and restore."""
        return not HIDDEN_TAGS.isdisjoint(self.tags.values())


class _Writer:
    """Writes one random tree, node by node."""

    def __init__(self, rng: random.Random, format: int) -> None:
        self.rng = rng
        self.format = format
        self.timers = MOST_TIMERS if rng.random() < 0.3 else 0
        self.scripted = format == 4 and rng.random() < 0.3
        self.users = rng.sample(list(_USER_NODES), 2) if format == 4 and rng.random() < 0.3 else []
        self.numbers = count(1)
        self.tags: dict[str, str] = {}
        self.attributes: dict[str, Attributes] = {}
        self.subtrees: list[str] = []
        self.racers: list[str] = []

    def element(self, leaves: int, depth: int = 0) -> str:
        """Return a random element with at most *leaves* leaves that are not built in."""
        rng = self.rng
        if leaves == 1 and (depth > 3 or rng.random() < 0.55):
            return self.leaf()
        if depth and rng.random() < 0.06:
            return self.subtree(leaves, depth)
        known = NODES[self.format]
        if self.users and leaves < 3 and rng.random() < 0.5:
            tag = self.users.pop(rng.randrange(len(self.users)))
            return self.written(tag, _USER_NODES[tag], leaves, depth)
        fitting = [tag for tag, kind in known.items() if (kind.most == 1 or leaves > 1 or depth < 1)]
        decorates = leaves == 1 or rng.random() < 0.35
        fitting = [
            tag
            for tag in fitting
            if (known[tag].most == 1) == decorates and (self.timers or tag not in _TIMED)
        ]
        # One of the Switch nodes, so that they are not in every second tree.
        switches = [tag for tag in fitting if tag.startswith("Switch")]
        fitting = [tag for tag in fitting if tag not in switches[1:]]
        # Several timers in a tree are more interesting than one.
        fitting += [tag for tag in fitting if tag in _TIMED] * 6
        tag = rng.choice(fitting)
        tag = rng.choice(switches) if tag in switches else tag
        kind = known[tag]
        self.timers -= tag in _TIMED
        return self.written(tag, kind, leaves, depth)

    def written(self, tag: str, kind: NodeKind, leaves: int, depth: int) -> str:
        """Return an element with children."""
        rng = self.rng
        wanted = max(kind.least, min(kind.most, rng.randint(1, leaves) if kind.most > 1 else 1))
        shares = [0] * wanted
        for _ in range(leaves):
            shares[rng.randrange(wanted)] += 1
        name = self.start(tag, kind.attributes(rng, wanted))
        inside = "".join(self.element(share, depth + 1) if share else self.filler() for share in shares)
        return f"<{self.head(name)}>{inside}</{tag}>"

    def start(self, tag: str, attributes: Attributes) -> str:
        """Return the name of a new node."""
        name = f"n{next(self.numbers)}"
        if self.scripted and self.rng.random() < 0.25:
            before = ["_successIf", "_failureIf", "_skipIf", "_while"]
            after = ["_onSuccess", "_onFailure", "_post", "_onHalted"]
            if self.rng.random() < 0.5:
                attributes = {**attributes, self.rng.choice(before): self.rng.choice(_CONDITIONS)}
            else:
                attributes = {**attributes, self.rng.choice(after): self.rng.choice(_STATEMENTS)}
        self.tags[name] = tag
        self.attributes[name] = attributes
        return name

    def head(self, name: str) -> str:
        """Return the tag and the attributes of a node as XML."""
        texts = "".join(f" {key}={quoteattr(text)}" for key, text in self.attributes[name].items())
        return f'{self.tags[name]} name="{name}"{texts}'

    def leaf(self) -> str:
        """Return a leaf: a scripted one, or a built-in one."""
        rng = self.rng
        if rng.random() < 0.2:
            built_in = _BUILT_IN[self.format]
            tag = rng.choice([tag for tag in built_in if tag != "Sleep" or self.timers])
            self.timers -= tag == "Sleep"
            return f"<{self.head(self.start(tag, built_in[tag](rng)))}/>"
        possible = [tag for tag in LEAVES if self.format == 4 or tag not in _FORMAT_4_LEAVES]
        tag = rng.choice([*possible, *_ACTIONS])
        ports = {} if LEAVES[tag].port is None else {"value": "{" + LEAVES[tag].key + "}"}
        return f"<{self.head(self.start(tag, ports))}/>"

    def race(self) -> str:
        """Return a Parallel of two delayed actions, of which the second delay begins after a leaf."""
        known = NODES[self.format]
        parallel = self.start("Parallel", known["Parallel"].attributes(self.rng, 2))
        delays = [self.start("Delay", known["Delay"].attributes(self.rng, 1)) for _ in range(2)]
        self.racers = [self.start("Move", {}), self.start("Move", {})]
        first, second = (
            f"<{self.head(delay)}><{self.head(racer)}/></Delay>"
            for delay, racer in zip(delays, self.racers, strict=True)
        )
        sequence, always = self.start("Sequence", {}), self.start("ForceSuccess", {})
        check = self.start("Check", {})
        slow = f"<{self.head(always)}><{self.head(check)}/></ForceSuccess>"
        return f"<{self.head(parallel)}>{first}<{self.head(sequence)}>{slow}{second}</Sequence></Parallel>"

    def filler(self) -> str:
        """Return a leaf without a choice."""
        return f"<{self.head(self.start(self.rng.choice(_FILLERS), {}))}/>"

    def subtree(self, leaves: int, depth: int) -> str:
        """Return a SubTree, which uses the entries of the tree around it."""
        id = f"Sub{len(self.subtrees)}"
        self.subtrees.append("")
        if self.format == 4:
            tag, attributes = "SubTree", {"ID": id, "_autoremap": "true"}
        else:
            shared = self.rng.random() < 0.5
            tag = "SubTree" if shared else "SubTreePlus"
            attributes = {"ID": id, "__shared_blackboard" if shared else "__autoremap": "true"}
        name = self.start(tag, attributes)
        written = f"<{self.head(name)}/>"
        inside = self.element(leaves, depth + 1)
        self.subtrees[int(id.removeprefix("Sub"))] = f'<BehaviorTree ID="{id}">{inside}</BehaviorTree>'
        return written


def random_tree(seed: str) -> RandomTree:
    """Return the random tree that follows from *seed*."""
    rng = random.Random(seed)
    format = rng.choice([4, 4, 3])
    writer = _Writer(rng, format)
    if writer.timers and rng.random() < 0.3:
        body = writer.race()
    else:
        body = writer.element(rng.choice([1, 2, 3, 3, MOST_LEAVES, MOST_LEAVES]))
    texts = [text for attributes in writer.attributes.values() for text in attributes.values()]
    for key, tag in (("u", "Note"), ("w", "Tell")):
        if any(key in _WORD.findall(text) for text in texts) and rng.random() < 0.7:
            first, leaf = writer.start("Sequence", {}), writer.start(tag, {"value": f"{{{key}}}"})
            body = f"<{writer.head(first)}><{writer.head(leaf)}/>{body}</Sequence>"
    trees = f'<BehaviorTree ID="Main">{body}</BehaviorTree>' + "".join(writer.subtrees)
    xml = f'<root BTCPP_format="{format}" main_tree_to_execute="Main">{trees}</root>'
    tree = RandomTree(format, xml, writer.tags, writer.attributes, [])
    if tree.leaves:
        tree.questions.extend(_random_questions(rng, tree))
    if writer.racers:
        first, second = (Atom("ticked", racer, "") for racer in writer.racers)
        tree.questions.extend(
            [RandomQuestion("before", first, second), RandomQuestion("before", second, first)]
        )
    return tree._replace(is_instant=rng.random() < 0.3)


def _random_questions(rng: random.Random, tree: RandomTree) -> list[RandomQuestion]:
    # The name of a SubTree of format 3 is the ID of its tree.
    named = [name for name, tag in tree.tags.items() if not tag.startswith("SubTree")]

    def atom() -> Atom:
        kind = rng.choice(["running", "is", "is", "ticked", "halted", "entry"])
        if kind == "entry":
            return Atom(kind, rng.choice("aamm" + "u" * ("Note" in tree.tags.values())), rng.choice("01"))
        leaf = rng.choice(tree.leaves)
        name = leaf if kind in ("ticked", "halted") else rng.choice([leaf, *named])
        return Atom(kind, name, rng.choice(["SUCCESS", "FAILURE"]) if kind == "is" else "")

    return [
        RandomQuestion("never", atom()),
        RandomQuestion("before", atom(), atom()),
        RandomQuestion("leads to", atom(), atom(), rng.randint(0, 3)),
        RandomQuestion("leads to", atom(), atom()),
    ]
