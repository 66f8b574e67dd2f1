"""Translation of a behavior tree from its XML to Promela, the language of the model checker spin.

The translation is independent of btcore: it follows the description of the nodes of BehaviorTree.CPP 4, and
reads only the XML. Each node becomes three inline macros: `tick_N`, `halt_N` and `reset_N`. The process ticks
the tree until it ends. One tick is atomic, and the propositions of the questions are updated at its end, in
one step.

- A model leaf chooses its result, and the values that it writes, nondeterministically.
- The values of entries are numbers: each text of the tree is represented by a number from `FIRST_TEXT` on.
- The time between two ticks is any number of steps. A step is so small that each order of the timers that is
  possible in real time is possible in steps. A tick takes no time, as with `--instant-leaves`.
- Fairness is a premise of the formulas of temporal logic. If each condition of fairness, "if A happens again
  and again, then B too", were written into the formula, spin's automata would grow exponentially. Instead the
  process chooses at its start which of these A cease at some time. `ceased` is true in a tick in which such
  an A happens nevertheless. `round` is true in a tick when each B of the other conditions has happened since
  the last such tick. The premise is then `<>[] !ceased && []<> round`.
"""

from collections.abc import Callable, Mapping, Sequence
from math import gcd
from typing import Any, Final

from lxml import etree
from promela_questions import Questions, Translation
from promela_tree import (
    FAILURE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Entries,
    LeafModel,
    Node,
    Script,
    UntranslatableError,
    leaf_models,
    read_nodes,
)

CONTROL_NODES: Final = {
    "Sequence": SUCCESS,
    "SequenceWithMemory": SUCCESS,
    "Fallback": FAILURE,
    "ReactiveSequence": SUCCESS,
    "ReactiveFallback": FAILURE,
}
"""The control nodes that continue after one result, which is also their result at the end."""
_CONSTANTS: Final = """#define UNSET -1000
#define RAISED 1
#define UNWRITTEN 2
#define IDLE 0
#define RUNNING 1
#define SUCCESS 2
#define FAILURE 3
#define SKIPPED 4"""
_EVENTS: Final = {
    **dict.fromkeys(("ticked", "succeeded", "failed", "skipped", "ran", "halted", "was_running"), "bool"),
    **dict.fromkeys(("returned_success", "returned_failure"), "bool"),
    "called": "byte",
}
"""What happened to each node in a tick, and the type of the array with it.

The code of a model leaf was called, and returned a result. `called` is the number of its last call among all
calls in the tick.
"""
_OTHER: Final = {SUCCESS: FAILURE, FAILURE: SUCCESS}


def promela(
    tree: str,
    models: str,
    leaves: Mapping[str, Mapping[str, Any]],
    entries: Mapping[str, Sequence[str]],
    questions: Sequence[str],
) -> Translation:
    """Return the translation of a tree.

    Args:
        tree: The XML text of the tree, a `root` element.
        models: The XML text with the TreeNodesModel.
        leaves: The declarations of leaves, by ID.
        entries: The values that leaves may write to entries, by key.
        questions: The questions beside the standard questions.

    Raises:
        UntranslatableError: The tree uses something that the translator does not know.
    """
    known = Entries()
    nodes = read_nodes(
        etree.fromstring(tree.encode()), leaf_models(etree.fromstring(models.encode()), leaves), known
    )
    return _Translator(nodes, known, entries).translation(questions)


class _Translator:
    def __init__(self, nodes: Sequence[Node], entries: Entries, domains: Mapping[str, Sequence[str]]) -> None:
        self._nodes = nodes
        self._entries = entries
        self._domains = domains
        self._timers = [node for node in nodes if node.duration is not None]

    def _timer(self, node: Node) -> str:
        return f"left_{node.number}"

    def _steps(self, node: Node) -> int:
        """Return the duration of a timer in steps."""
        durations = [timer.duration or 0 for timer in self._timers]
        return (node.duration or 0) // (gcd(*durations) or 1) * 2 * len(durations)

    # --- halting

    def _halt(self, node: Node) -> str:
        """Return the macros `halt_N` and `reset_N`."""
        i = node.number
        lines: list[str] = []
        for variable in self._progress(node):
            lines.append(f"{variable} = 0;")
        if node in self._timers:
            lines.append(f"{self._timer(node)} = 0;")
        lines += [f"reset_{child.number}();" for child in node.children]
        lines.append(f"st[{i}] = IDLE;")
        halted = self._scripts(node, "_onHalted")
        return _inline(f"halt_{i}", [*lines, *halted]) + _inline(
            f"reset_{i}",
            [f"if :: (st[{i}] == RUNNING) -> halted[{i}] = true; halt_{i}() :: else fi;", f"st[{i}] = IDLE;"],
        )

    def _progress(self, node: Node) -> list[str]:
        """Return the variables of a node that a halt sets to 0."""
        i = node.number
        match node.tag:
            case "Sequence" | "Fallback":
                return [f"place_{i}", f"skips_{i}"]
            case "SequenceWithMemory":
                return [f"skips_{i}"]
            case "Repeat" | "RetryUntilSuccessful":
                return [f"count_{i}"]
            case "IfThenElse" | "Switch2":
                return [f"branch_{i}"]
            case "Parallel" | "ParallelAll":
                done = [f"done_{i}_{number}" for number in range(len(node.children))]
                return [*done, f"successes_{i}", f"failures_{i}"]
            case "Delay" | "Timeout":
                return [f"started_{i}"]
        return []

    def _memory(self, node: Node) -> list[str]:
        """Return the variables of a node that a halt keeps."""
        i = node.number
        kept = {
            "SequenceWithMemory": [f"place_{i}"],
            "RunOnce": [f"result_{i}"],
            "Parallel": [f"skips_{i}"],
            "ParallelAll": [f"skips_{i}"],
            "ReactiveSequence": [f"skips_{i}"],
            "ReactiveFallback": [f"skips_{i}"],
        }
        return kept.get(node.tag, [])

    # --- ticking

    def _tick(self, node: Node) -> str:
        """Return the macro `tick_N`: conditions, the rule of the node, scripts after it, and its status."""
        i = node.number
        lines = [f"r[{i}] = IDLE;"]
        starts: list[str] = []
        for attribute, result in (("_failureIf", FAILURE), ("_successIf", SUCCESS), ("_skipIf", SKIPPED)):
            starts += self._condition(node, attribute, f"r[{i}] = {result}", "skip")
        starts += self._condition(node, "_while", "skip", f"r[{i}] = SKIPPED")
        if starts:
            stop = self._condition(
                node, "_while", "skip", f"halted[{i}] = true; halt_{i}(); r[{i}] = SKIPPED"
            )
            lines += ["if", f":: (st[{i}] == IDLE || st[{i}] == SKIPPED) ->", *starts]
            lines += [f":: (st[{i}] == RUNNING) ->", *(stop or ["skip"]), ":: else", "fi;"]
        lines += _when(f"r[{i}] == IDLE", self._rule(node))
        lines += _when(f"r[{i}] == SUCCESS", self._scripts(node, "_onSuccess"))
        lines += _when(f"r[{i}] == FAILURE", self._scripts(node, "_onFailure"))
        lines += _when(f"r[{i}] == SUCCESS || r[{i}] == FAILURE", self._scripts(node, "_post"))
        lines += [
            f"if :: (r[{i}] != SKIPPED) -> st[{i}] = r[{i}] :: else -> skipped[{i}] = true fi;",
            f"ticked[{i}] = true;",
            f"if :: (r[{i}] == SUCCESS) -> succeeded[{i}] = true :: (r[{i}] == FAILURE) -> "
            f"failed[{i}] = true :: (r[{i}] == RUNNING) -> ran[{i}] = true :: else fi;",
        ]
        return _inline(f"tick_{i}", lines)

    def _condition(self, node: Node, attribute: str, if_true: str, if_false: str) -> list[str]:
        """Return statements for a precondition that has not been decided by an earlier one."""
        text = node.attributes.get(attribute)
        if text is None:
            return []
        checks, expression = Script(text, node.scope, self._entries).condition()
        choice = f"if :: ({expression}) -> {if_true} :: else -> {if_false} fi"
        return _when(f"r[{node.number}] == IDLE", [*checks, choice + ";"])

    def _scripts(self, node: Node, attribute: str) -> list[str]:
        text = node.attributes.get(attribute)
        return Script(text, node.scope, self._entries).statements() if text is not None else []

    def _rule(self, node: Node) -> list[str]:
        """Return the statements that set the result `r[N]` of a node."""
        i = node.number
        if node.model is not None:
            return self._model_leaf(node, node.model)
        if node.tag in ("Sequence", "Fallback", "SequenceWithMemory"):
            return self._sequence(node)
        if node.tag in CONTROL_NODES:
            return self._reactive(node)
        rules: dict[str, Callable[[Node], list[str]]] = {
            "Script": self._script,
            "ScriptCondition": self._script_condition,
            "SetBlackboard": self._set_blackboard,
            "Sleep": self._sleep,
            "Parallel": self._parallel,
            "ParallelAll": self._parallel_all,
            "IfThenElse": self._if_then_else,
            "WhileDoElse": self._while_do_else,
            "Switch2": self._switch,
            "Delay": self._delay,
            "Timeout": self._timeout,
            "Repeat": self._repeat,
            "RetryUntilSuccessful": self._repeat,
            "RunOnce": self._run_once,
        }
        if node.tag in rules:
            return rules[node.tag](node)
        results = {
            "Inverter": {SUCCESS: FAILURE, FAILURE: SUCCESS, SKIPPED: SKIPPED},
            "ForceSuccess": {SUCCESS: SUCCESS, FAILURE: SUCCESS, SKIPPED: SKIPPED},
            "ForceFailure": {SUCCESS: FAILURE, FAILURE: FAILURE, SKIPPED: SKIPPED},
            "KeepRunningUntilFailure": {SUCCESS: RUNNING, FAILURE: FAILURE, SKIPPED: RUNNING},
            "SubTree": {SUCCESS: SUCCESS, FAILURE: FAILURE, SKIPPED: SKIPPED},
        }.get(node.tag)
        if results is None:
            raise UntranslatableError(f"<{node.tag}>")
        child = node.children[0].number
        return [
            f"st[{i}] = RUNNING;",
            f"tick_{child}();",
            "if",
            *(
                f":: (r[{child}] == {of}) -> r[{i}] = {to}"
                for of, to in {**results, RUNNING: RUNNING}.items()
            ),
            "fi;",
            *self._reset_completed(node),
        ]

    def _reset_completed(self, node: Node) -> list[str]:
        """Return the statements that reset the child of a decorator if it has completed."""
        child = node.children[0].number
        completed = f"st[{child}] == SUCCESS || st[{child}] == FAILURE"
        return [f"if :: ({completed}) -> reset_{child}() :: else fi;"]

    def _reset_all(self, node: Node, but: Node | None = None, since: int = 0) -> str:
        resets = [f"reset_{child.number}();" for child in node.children[since:] if child is not but]
        return " ".join(resets) or "skip;"

    # --- leaves

    def _model_leaf(self, node: Node, model: LeafModel) -> list[str]:
        i = node.number
        lines: list[str] = []
        for port in sorted(model.inputs):
            value = node.attributes.get(port, "")
            if value.startswith("{"):
                entry = self._entries.variable(node.scope, value[1:-1])
                lines.append(f"if :: ({entry} == UNSET) -> error = UNWRITTEN; goto finish :: else fi;")
        writes = [
            (self._entries.variable(node.scope, node.attributes[port][1:-1]), self._domain(node, port))
            for port in model.outputs
            if port in node.attributes
        ]
        options: list[str] = []
        every = " ".join(
            "if " + " ".join(f":: {entry} = {value}" for value in values) + " fi;" for entry, values in writes
        )
        for result in model.results:
            if result == SUCCESS or (result == FAILURE and writes):
                options.append(f":: {every} r[{i}] = {result}")
            if result != SUCCESS:
                options.append(f":: r[{i}] = {result}")
        if model.lasts or model.endless:
            options.append(f":: r[{i}] = RUNNING")
        call = [*lines, f"calls++; called[{i}] = calls;", *self._conflicts(node, model)]
        choice = [*call, "if", *options, "fi;"]
        choice += [
            f"if :: (r[{i}] == SUCCESS) -> returned_success[{i}] = true",
            f":: (r[{i}] == FAILURE) -> returned_failure[{i}] = true :: else fi;",
        ]
        if not model.lasts:
            return choice
        if model.at_once:
            cases = [f":: (st[{i}] == IDLE || st[{i}] == RUNNING) ->", *choice]
        else:
            start = [*call, f"r[{i}] = RUNNING;"]
            cases = [f":: (st[{i}] == IDLE) ->", *start, f":: (st[{i}] == RUNNING) ->", *choice]
        # A completed action that was not reset returns its result again.
        return ["if", *cases, f":: else -> r[{i}] = st[{i}]", "fi;"]

    def _conflicts(self, node: Node, model: LeafModel) -> list[str]:
        """Return the statement that sets `clash` if a leaf starts while another uses a resource of it.

        An action that lasts uses its resources while it is RUNNING, any other leaf when it is ticked.
        """
        others = [
            f"st[{other.number}] == RUNNING"
            for other in self._nodes
            if other is not node and other.model is not None and other.model.uses & model.uses
        ]
        if not others:
            return []
        starts = f"st[{node.number}] != RUNNING && ({' || '.join(others)})"
        return [f"if :: ({starts}) -> clash = true :: else fi;"]

    def _domain(self, node: Node, port: str) -> list[str]:
        key = node.attributes[port][1:-1]
        if key not in self._domains:
            raise UntranslatableError(f"the domain of {{{key}}}")
        return [self._entries.number(text) for text in self._domains[key]]

    def _script(self, node: Node) -> list[str]:
        return [*self._scripts(node, "code"), f"r[{node.number}] = SUCCESS;"]

    def _script_condition(self, node: Node) -> list[str]:
        checks, expression = Script(node.attributes["code"], node.scope, self._entries).condition()
        i = node.number
        return [*checks, f"if :: ({expression}) -> r[{i}] = SUCCESS :: else -> r[{i}] = FAILURE fi;"]

    def _set_blackboard(self, node: Node) -> list[str]:
        i, value = node.number, node.attributes["value"]
        target = self._entries.variable(node.scope, node.attributes["output_key"])
        if not value.startswith("{"):
            return [f"{target} = {self._entries.number(value)}; r[{i}] = SUCCESS;"]
        source = self._entries.variable(node.scope, value[1:-1])
        copied = f"{target} = {source}; r[{i}] = SUCCESS"
        return [f"if :: ({source} == UNSET) -> r[{i}] = FAILURE :: else -> {copied} fi;"]

    def _sleep(self, node: Node) -> list[str]:
        i, timer, steps = node.number, self._timer(node), self._steps(node)
        start = f"{timer} = {steps}; fresh_{i} = true; r[{i}] = RUNNING" if steps else f"r[{i}] = SUCCESS"
        return [
            f"if :: (st[{i}] == IDLE) -> {start}",
            f":: (st[{i}] == RUNNING && {timer} > 0) -> r[{i}] = RUNNING",
            f":: (st[{i}] == RUNNING && {timer} == 0) -> r[{i}] = SUCCESS",
            f":: else -> r[{i}] = st[{i}] fi;",
        ]

    # --- control nodes

    def _sequence(self, node: Node) -> list[str]:
        i, count = node.number, len(node.children)
        goes_on = CONTROL_NODES[node.tag]
        ends = _OTHER[goes_on]
        with_memory = node.tag == "SequenceWithMemory"
        lines = [
            f"if :: (st[{i}] == IDLE) -> skips_{i} = 0 :: else fi;",
            f"st[{i}] = RUNNING;",
        ]
        for place, child in enumerate(node.children):
            c = child.number
            end = (
                self._reset_all(node, since=place)
                if with_memory
                else f"{self._reset_all(node)} place_{i} = 0;"
            )
            pause = "skip"
            if with_memory and place + 1 < count:
                pause = f"if :: idle_{c} -> r[{i}] = RUNNING :: else fi"
            lines += _when(
                f"r[{i}] == IDLE && place_{i} == {place}",
                [
                    f"idle_{c} = (st[{c}] == IDLE);",
                    f"tick_{c}();",
                    f"if :: (r[{c}] == RUNNING) -> r[{i}] = RUNNING",
                    f":: (r[{c}] == {ends}) -> {end} r[{i}] = {ends}",
                    f":: (r[{c}] == {goes_on}) -> place_{i}++; {pause}",
                    f":: (r[{c}] == SKIPPED) -> place_{i}++; skips_{i}++ fi;",
                ],
            )
        result = f"if :: (skips_{i} == {count}) -> r[{i}] = SKIPPED :: else -> r[{i}] = {goes_on} fi"
        return [
            *lines,
            *_when(f"r[{i}] == IDLE", [f"{self._reset_all(node)} place_{i} = 0; {result}; skips_{i} = 0;"]),
        ]

    def _reactive(self, node: Node) -> list[str]:
        i, count = node.number, len(node.children)
        goes_on = CONTROL_NODES[node.tag]
        ends = _OTHER[goes_on]
        lines = [f"st[{i}] = RUNNING; skips_{i} = 0;"]
        for child in node.children:
            c = child.number
            lines += _when(
                f"r[{i}] == IDLE",
                [
                    f"tick_{c}();",
                    f"if :: (r[{c}] == RUNNING) -> {self._reset_all(node, but=child)} r[{i}] = RUNNING",
                    f":: (r[{c}] == {ends}) -> {self._reset_all(node)} r[{i}] = {ends}",
                    f":: (r[{c}] == {goes_on}) -> skip",
                    f":: (r[{c}] == SKIPPED) -> reset_{c}(); skips_{i}++ fi;",
                ],
            )
        result = f"if :: (skips_{i} == {count}) -> r[{i}] = SKIPPED :: else -> r[{i}] = {goes_on} fi"
        return [
            *lines,
            *_when(f"r[{i}] == IDLE", [f"{self._reset_all(node)} {result};"]),
            f"skips_{i} = 0;",
        ]

    def _parallel(self, node: Node) -> list[str]:
        i, count = node.number, len(node.children)
        given = int(node.attributes.get("success_count", "-1"))
        success = _threshold(given, count)
        failure = _threshold(int(node.attributes.get("failure_count", "1")), count)
        if count < success or count < failure:
            return ["error = RAISED; goto finish;"]
        clear = " ".join(f"{name} = 0;" for name in self._progress(node))
        enough = f"successes_{i} >= {success}"
        if given < 0:
            enough += f" || successes_{i} + skips_{i} >= {success}"
        too_many = f"{count} - failures_{i} < {success} || failures_{i} == {failure}"
        lines = [f"st[{i}] = RUNNING; skips_{i} = 0;"]
        for place, child in enumerate(node.children):
            lines += _when(
                f"r[{i}] == IDLE",
                [
                    *self._tick_unless_done(node, place, child),
                    f"if :: ({enough}) -> {clear} {self._reset_all(node)} r[{i}] = SUCCESS",
                    f":: (!({enough}) && ({too_many})) -> {clear} {self._reset_all(node)} r[{i}] = FAILURE",
                    ":: else fi;",
                ],
            )
        return [
            *lines,
            *_when(
                f"r[{i}] == IDLE",
                [f"if :: (skips_{i} == {count}) -> r[{i}] = SKIPPED :: else -> r[{i}] = RUNNING fi;"],
            ),
            f"skips_{i} = 0;",
        ]

    def _parallel_all(self, node: Node) -> list[str]:
        i, count = node.number, len(node.children)
        most = _threshold(int(node.attributes.get("max_failures", "1")), count)
        if most > count:
            return ["error = RAISED; goto finish;"]
        clear = " ".join(f"{name} = 0;" for name in self._progress(node))
        lines = [f"st[{i}] = RUNNING; skips_{i} = 0;"]
        for place, child in enumerate(node.children):
            lines += self._tick_unless_done(node, place, child)
        done = f"successes_{i} + failures_{i} + skips_{i} >= {count}"
        result = f"if :: (failures_{i} >= {most}) -> r[{i}] = FAILURE :: else -> r[{i}] = SUCCESS fi;"
        return [
            *lines,
            f"if :: (skips_{i} == {count}) -> r[{i}] = SKIPPED",
            f":: (skips_{i} < {count} && {done}) -> {result} {clear} {self._reset_all(node)}",
            f":: else -> r[{i}] = RUNNING fi;",
            f"skips_{i} = 0;",
        ]

    def _tick_unless_done(self, node: Node, place: int, child: Node) -> list[str]:
        i, c = node.number, child.number
        return _when(
            f"!done_{i}_{place}",
            [
                f"tick_{c}();",
                f"if :: (r[{c}] == SUCCESS) -> done_{i}_{place} = 1; successes_{i}++",
                f":: (r[{c}] == FAILURE) -> done_{i}_{place} = 1; failures_{i}++",
                f":: (r[{c}] == SKIPPED) -> skips_{i}++ :: else fi;",
            ],
        )

    def _if_then_else(self, node: Node) -> list[str]:
        i, condition = node.number, node.children[0].number
        has_else = len(node.children) == 3
        lines = [f"st[{i}] = RUNNING;"]
        lines += _when(
            f"branch_{i} == 0",
            [
                f"tick_{condition}();",
                f"if :: (r[{condition}] == RUNNING) -> r[{i}] = RUNNING",
                f":: (r[{condition}] == SUCCESS) -> branch_{i} = 1",
                f":: (r[{condition}] == FAILURE) -> "
                + (f"branch_{i} = 2" if has_else else f"r[{i}] = FAILURE"),
                f":: (r[{condition}] == SKIPPED) -> error = RAISED; goto finish fi;",
            ],
        )
        for place, child in enumerate(node.children[1:], 1):
            lines += _when(
                f"r[{i}] == IDLE && branch_{i} == {place}",
                [
                    f"tick_{child.number}();",
                    f"r[{i}] = r[{child.number}];",
                    f"if :: (r[{i}] != RUNNING) -> {self._reset_all(node)} branch_{i} = 0 :: else fi;",
                ],
            )
        return lines

    def _while_do_else(self, node: Node) -> list[str]:
        i, condition, first = node.number, node.children[0].number, node.children[1].number
        has_else = len(node.children) == 3
        halt_else, on_failure = "", f"r[{i}] = FAILURE"
        if has_else:
            other = node.children[2].number
            halt_else = f"reset_{other}();"
            on_failure = f"reset_{first}(); tick_{other}(); r[{i}] = r[{other}]"
        return [
            f"st[{i}] = RUNNING;",
            f"tick_{condition}();",
            f"if :: (r[{condition}] == RUNNING) -> r[{i}] = RUNNING",
            f":: (r[{condition}] == SUCCESS) -> {halt_else} tick_{first}(); r[{i}] = r[{first}]",
            f":: (r[{condition}] == FAILURE) -> {on_failure}",
            f":: (r[{condition}] == SKIPPED) -> error = RAISED; goto finish fi;",
            f"if :: (r[{i}] != RUNNING) -> {self._reset_all(node)} :: else fi;",
        ]

    def _switch(self, node: Node) -> list[str]:
        i = node.number
        value = node.attributes["variable"]
        entry = self._entries.variable(node.scope, value[1:-1])
        cases = [self._entries.number(node.attributes[f"case_{number}"]) for number in (1, 2)]
        conditions = [f"{entry} == {cases[0]}", f"{entry} != {cases[0]} && {entry} == {cases[1]}", "else"]
        lines = ["if"]
        for place, (condition, child) in enumerate(zip(conditions, node.children, strict=True), 1):
            others = [
                f"if :: (branch_{i} == {other}) -> reset_{each.number}() :: else fi;"
                for other, each in enumerate(node.children, 1)
                if other != place
            ]
            lines += [
                f":: {condition if condition == 'else' else f'({condition})'} ->",
                *others,
                f"tick_{child.number}(); r[{i}] = r[{child.number}];",
                f"if :: (r[{i}] == SKIPPED) -> branch_{i} = 0",
                f":: (r[{i}] == RUNNING) -> branch_{i} = {place}",
                f":: else -> {self._reset_all(node)} branch_{i} = 0 fi;",
            ]
        return [*lines, "fi;"]

    # --- decorators

    def _repeat(self, node: Node) -> list[str]:
        counted, port = (SUCCESS, "num_cycles") if node.tag == "Repeat" else (FAILURE, "num_attempts")
        i, child, limit = node.number, node.children[0].number, int(node.attributes[port])
        ends = _OTHER[counted]
        again = f"count_{i} < {limit}" if limit >= 0 else "true"
        count = f"count_{i}++;" if limit >= 0 else ""
        return [
            f"st[{i}] = RUNNING;",
            "do",
            f":: (r[{i}] == IDLE && {again}) ->",
            f"idle_{child} = (st[{child}] == IDLE);",
            f"tick_{child}();",
            f"if :: (r[{child}] == {counted}) -> {count} reset_{child}();",
            # The tree may be woken between two attempts.
            f"if :: (idle_{child} && {again}) -> r[{i}] = RUNNING :: else fi",
            f":: (r[{child}] == {ends}) -> count_{i} = 0; reset_{child}(); r[{i}] = {ends}",
            f":: (r[{child}] == RUNNING) -> r[{i}] = RUNNING",
            f":: (r[{child}] == SKIPPED) -> reset_{child}(); r[{i}] = SKIPPED fi",
            ":: else -> break",
            "od;",
            *_when(f"r[{i}] == IDLE", [f"count_{i} = 0; r[{i}] = {counted};"]),
            f"idle_{child} = 0;",
        ]

    def _run_once(self, node: Node) -> list[str]:
        i, child = node.number, node.children[0].number
        skips = node.attributes.get("then_skip", "true") == "true"
        later = SKIPPED if skips else f"result_{i}"
        return [
            "if",
            f":: (result_{i} != 0) -> r[{i}] = {later}",
            f":: else -> st[{i}] = RUNNING;",
            f"tick_{child}(); r[{i}] = r[{child}];",
            f"if :: (r[{i}] == SUCCESS || r[{i}] == FAILURE) -> result_{i} = r[{i}]; reset_{child}() "
            ":: else fi",
            "fi;",
            *self._reset_completed(node),
        ]

    def _delay(self, node: Node) -> list[str]:
        i, child, timer = node.number, node.children[0].number, self._timer(node)
        return [
            "if",
            f":: (!started_{i}) -> st[{i}] = RUNNING; started_{i} = 1; {timer} = {self._steps(node)};",
            f"fresh_{i} = true; r[{i}] = RUNNING",
            f":: (started_{i} && {timer} > 0) -> r[{i}] = RUNNING",
            f":: (started_{i} && {timer} == 0) -> tick_{child}(); r[{i}] = r[{child}];",
            f"if :: (r[{i}] == SUCCESS || r[{i}] == FAILURE) -> started_{i} = 0; reset_{child}() :: else fi",
            "fi;",
        ]

    def _timeout(self, node: Node) -> list[str]:
        i, child, timer = node.number, node.children[0].number, self._timer(node)
        steps = self._steps(node)
        # started: 0 = no, 1 = the time runs, 2 = there is no limit, or it passed without effect
        first = f"started_{i} = 1; {timer} = {steps}; fresh_{i} = true" if steps else f"started_{i} = 2"
        return [
            f"if :: (started_{i} == 0) -> st[{i}] = RUNNING; {first}",
            f":: (started_{i} == 1 && {timer} == 0) ->",
            f"if :: (st[{child}] == RUNNING) -> reset_{child}(); started_{i} = 0; r[{i}] = FAILURE",
            f":: else -> started_{i} = 2 fi",
            ":: else fi;",
            *_when(
                f"r[{i}] == IDLE",
                [
                    f"tick_{child}(); r[{i}] = r[{child}];",
                    f"if :: (r[{i}] == SUCCESS || r[{i}] == FAILURE) -> "
                    f"started_{i} = 0; {timer} = 0; reset_{child}() :: else fi;",
                ],
            ),
        ]

    # --- the program

    def translation(self, questions: Sequence[str]) -> Translation:
        """Return the whole program with the formulas of the standard questions and of *questions*."""
        # A macro must be defined before its first use.
        macros = [self._halt(node) + self._tick(node) for node in reversed(self._nodes)]
        asked = Questions(self._nodes, self._entries)
        asked.add_standard()
        for question in questions:
            asked.add(question)
        count = len(self._nodes)
        parts = [
            _CONSTANTS,
            f"byte st[{count}], r[{count}], error, elapsed, calls; bool over, clash;",
            *(f"{kind} {name}[{count}];" for name, kind in _EVENTS.items()),
            *(f"byte {', '.join(self._variables(node))};" for node in self._nodes),
            *self._entries.declarations(),
            *asked.variables,
            *macros,
            "active proctype tree() {",
            *asked.start,
            "do :: atomic {",
            *self._pass_time(),
            *(f"was_running[{i}] = (st[{i}] == RUNNING);" for i in range(count)),
            "tick_0();",
            "finish: skip; d_step {",
            "over = (error != 0 || r[0] != RUNNING);",
            # The tree resets its root when it completes; a skipped root keeps its status.
            "if :: (!error && (r[0] == SUCCESS || r[0] == FAILURE)) -> st[0] = IDLE :: else fi;",
            *asked.updates,
            *(f"{name}[{i}] = 0;" for name in (*_EVENTS, "r") for i in range(count)),
            *(f"fresh_{node.number} = 0;" for node in self._timers),
            *(f"idle_{i} = 0;" for i in range(count)),
            "calls = 0; clash = false;",
            "}",
            "if :: over -> break :: else fi",
            "} od }",
            *asked.formulas,
        ]
        asked.result.program = "\n".join([*parts, ""])
        return asked.result

    def _variables(self, node: Node) -> list[str]:
        """Return the variables of one node."""
        own = [f"idle_{node.number}", *self._progress(node), *self._memory(node)]
        return [*own, self._timer(node), f"fresh_{node.number}"] if node in self._timers else own

    def _pass_time(self) -> list[str]:
        """Return statements that let any time pass, until the last timer has expired at most."""
        if not self._timers:
            return []
        timers = [self._timer(node) for node in self._timers]
        more = " || ".join(f"{timer} > elapsed" for timer in timers)
        return [
            "elapsed = 0;",
            f"do :: ({more}) -> elapsed++ :: break od;",
            *(
                f"if :: ({timer} > elapsed) -> {timer} = {timer} - elapsed :: else -> {timer} = 0 fi;"
                for timer in timers
            ),
            "elapsed = 0;",
        ]


def _threshold(number: int, children: int) -> int:
    return max(number + children + 1, 0) if number < 0 else number


def _inline(name: str, lines: Sequence[str]) -> str:
    return "\n".join([f"inline {name}() {{", *(f"  {line}" for line in lines), "}\n"])


def _when(condition: str, lines: Sequence[str]) -> list[str]:
    """Return the statements that are executed if *condition* holds; none if there are none."""
    if not lines:
        return []
    return ["if", f":: ({condition}) ->", *lines, ":: else", "fi;"]
