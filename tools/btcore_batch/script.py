"""Scripts of a batch: the parsed scripts of `btcore.script`, evaluated on columns.

There is a class for each class of `btcore.script.expressions`. For numbers, a set of agents records
whose value is an integer: arithmetic returns reals; literals, copies and entries may be integers. The
difference matters for `&&`, for conditions and for new entries. Expressions with texts and other
objects, which arrays cannot compute, are evaluated agent by agent, by the ordinary engine's operators.
"""

from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from btcore.blackboard.blackboard import Entry
from btcore.errors import BlackboardError, BtcoreError, ConversionError, ScriptError
from btcore.script.expressions import (
    Assignment,
    Comparison,
    ConditionalExpression,
    Expression,
    Literal,
    Name,
    OperatorChain,
    UnaryOperation,
)
from btcore.script.operators import EPSILON, OPERATORS, compare, compound_assigned_value, negate, operate
from btcore.script.program import Parser, condition_result
from btcore.values.numbers import leading_float
from btcore.values.types import INT64, MAX_EXACT, as_double, number_of
from btcore_batch.agent_sets import AgentSet
from btcore_batch.columns import NUMBER, OBJECT, TEXT, TRUTH, BatchValue, Column, Slot, Values, to_objects
from btcore_batch.context import NodeLike

_AND: Final = OPERATORS["&&"]
_OR: Final = OPERATORS["||"]
_ARITHMETIC: Final[dict[int, Any]] = {
    OPERATORS["+"]: np.add,
    OPERATORS["-"]: np.subtract,
    OPERATORS["*"]: np.multiply,
    OPERATORS["/"]: np.divide,
}
_COMPOUND: Final[dict[str, Any]] = {"+=": np.add, "-=": np.subtract, "*=": np.multiply, "/=": np.divide}
# `a < b` is evaluated as `not a >= b`, as in BehaviorTree.CPP, so that comparisons with NaN are true.
_NEGATED_COMPARISONS: Final[dict[str, Any]] = {
    "<": np.greater_equal,
    ">": np.less_equal,
    "<=": np.greater,
    ">=": np.less,
}
NO_VALUE: Final = BatchValue(0.0, NUMBER, 0)
"""The result if no agents are left to evaluate for."""


class ScriptRun:
    """One evaluation of a script. An error for an agent ends the evaluation and the tick of this agent."""

    def __init__(self, node: NodeLike, doing: str) -> None:
        self.context = node.context
        self.agent_sets = node.context.agent_sets
        self.node = node
        self.doing = doing
        self.failed = 0

    def fail(self, agents: AgentSet, error: BtcoreError) -> None:
        """Record *error* for *agents*."""
        self.failed |= agents
        self.context.fail(self.node, agents, error, self.doing)

    def drop_failed(self, agents: AgentSet) -> AgentSet:
        """Return those of *agents* for which the evaluation has not failed."""
        return agents ^ (agents & self.failed) if self.failed else agents

    def apply_each(
        self,
        agents: AgentSet,
        function: Callable[..., object],
        values: tuple[BatchValue, ...],
        script_error: Callable[[str], BtcoreError],
    ) -> tuple[Values, int]:
        """Call `function(value, …)` for each of *agents*.

        Args:
            function: Computes the result of a single agent, or raises ConversionError.
            values: The arguments.
            script_error: Returns an error with the position in the script, given the message of a
                ConversionError.

        Returns:
            The results as Python objects, and the agents for which *function* did not fail.
        """
        arguments = [to_objects(value, self.agent_sets, agents) for value in values]
        results = np.full(self.agent_sets.count, None, dtype=object)
        for index in self.agent_sets.indices(agents):
            try:
                results[index] = function(*[objects[index] for objects in arguments])
            except ConversionError as error:
                self.fail(1 << int(index), script_error(str(error)))
        return results, self.drop_failed(agents)

    def value_from_objects(self, objects: Values, agents: AgentSet) -> BatchValue:
        """Return Python objects as a value of the simplest form that is possible for *agents*."""
        mask = self.agent_sets.mask(agents)
        selected = objects[mask]
        types = {type(value) for value in selected}
        if types <= {float}:
            data = np.zeros(self.agent_sets.count)
            data[mask] = selected
            return BatchValue(data, NUMBER, 0)
        return BatchValue(objects, TEXT if types == {str} else OBJECT, 0)


class Scope(NamedTuple):
    """The names that an expression can use.

    Attributes:
        node: The node whose blackboard has the entries.
        enums: The numbers of the enum names.
        copies: Whether to copy the values of entries, because the same statement may change them.
    """

    node: NodeLike
    enums: Mapping[str, int]
    copies: bool

    def slot(self, key: str) -> Slot:
        """Return the slot of *key*."""
        return Slot(self.node.context.columns, self.node.board, key)


def column_value(column: Column, agents: AgentSet, copies: bool) -> BatchValue:
    """Return the value of *column* for *agents*; *copies* as in `Scope`."""
    if not agents:
        return NO_VALUE
    # Agents without a value get None, which most operators reject with an error for these agents only.
    if column.values is None or column.written & agents != agents:
        return BatchValue(column.objects(agents), OBJECT, 0)
    values = column.values.copy() if copies else column.values
    return BatchValue(values, column.form, column.integers_among(agents))


def to_doubles(value: BatchValue) -> Any:
    """Return the numbers of *value* as float64: an array or a float."""
    data = value.data
    if isinstance(data, np.ndarray):
        return data if data.dtype == np.float64 else data.astype(np.float64)
    return float(data)


def is_number(value: BatchValue) -> bool:
    """Return whether arithmetic on arrays is possible."""
    return value.form is NUMBER or value.form is TRUTH


class BatchExpression:
    """A part of a script."""

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the value for *agents*; record errors in *run*."""
        raise NotImplementedError


class BatchLiteral(BatchExpression):
    """A number or a text."""

    def __init__(self, value: object) -> None:
        if isinstance(value, str):
            self.value = BatchValue(value, TEXT, 0)
        elif isinstance(value, int) and abs(value) > MAX_EXACT:
            self.value = BatchValue(value, OBJECT, 0)
        else:
            # -1 has all bits set: an integer for all agents, whatever their number.
            self.value = BatchValue(value, NUMBER, -1 if isinstance(value, int) else 0)

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the literal."""
        return self.value


class BatchName(BatchExpression):
    """A name in an expression, which stands for the value of the blackboard entry with this name."""

    def __init__(self, name: Name, scope: Scope) -> None:
        self.name = name
        self.copies = scope.copies
        self.slot = scope.slot(name.name)

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the value of the entry."""
        column = self.slot.column
        if column is None or column.exists & agents != agents:
            missing = agents if column is None else agents ^ (agents & column.exists)
            run.fail(missing, self.name.error(f"there is no variable '{self.name.name}' on the blackboard"))
            agents ^= missing
        if column is None or not agents:
            return NO_VALUE
        return column_value(column, agents, self.copies)


class BatchUnaryOperation(BatchExpression):
    """`-`, `~` or `!`, or several of them, before a value."""

    def __init__(self, operation: UnaryOperation, scope: Scope) -> None:
        self.operation = operation
        self.operand = compile_expression(operation.operand, scope)

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the value after the operators, which is a real number for each agent."""
        value = self.operand.evaluate(run, agents)
        agents = run.drop_failed(agents)
        for sign in reversed(self.operation.signs):
            # "~" is left to the ordinary engine, which checks the range of the operand.
            if is_number(value) and sign != "~":
                data = to_doubles(value)
                value = BatchValue(-data if sign == "-" else data == 0.0, NUMBER, 0)
            else:
                results, agents = run.apply_each(
                    agents, lambda operand, sign=sign: negate(sign, operand), (value,), self.operation.error
                )
                value = run.value_from_objects(results, agents)
        return value


class BatchChain(BatchExpression):
    """The base class of expressions with operands that are evaluated from left to right."""

    def __init__(self, chain: OperatorChain | Comparison, scope: Scope) -> None:
        self.text = chain.text
        self.tokens = chain.tokens
        self.first = compile_expression(chain.first, scope)
        self.operands = [compile_expression(operand, scope) for operand in chain.operands]

    def error(self, index: int, message: str) -> ScriptError:
        """Return an error at the operator *index*."""
        token = self.tokens[index]
        return ScriptError(message, self.text, token.start + 1, token.width)


class BatchBinaryOperations(BatchChain):
    """A value, and operators with their operands: `a + b .. c`."""

    def __init__(self, chain: OperatorChain, scope: Scope) -> None:
        super().__init__(chain, scope)
        self.operators = chain.operators

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the value after the last operator."""
        left = self.first.evaluate(run, agents)
        for index, operand in enumerate(self.operands):
            agents = run.drop_failed(agents)
            if not agents:
                return NO_VALUE
            right = operand.evaluate(run, agents)
            agents = run.drop_failed(agents)
            left = self._operate(run, agents, index, left, right)
        return left

    def _operate(
        self, run: ScriptRun, agents: AgentSet, index: int, left: BatchValue, right: BatchValue
    ) -> BatchValue:
        operator = self.operators[index]
        if is_number(left) and is_number(right):
            function = _ARITHMETIC.get(operator)
            if function is not None:
                return BatchValue(function(to_doubles(left), to_doubles(right)), NUMBER, 0)
            if operator in (_AND, _OR):
                first, second = self._truths(left, agents), self._truths(right, agents)
                if first is not None and second is not None:
                    return BatchValue(first & second if operator == _AND else first | second, NUMBER, 0)
        results, agents = run.apply_each(
            agents,
            lambda first, second: operate(operator, first, second),
            (left, right),
            lambda message: self.error(index, message),
        )
        return run.value_from_objects(results, agents)

    def _truths(self, value: BatchValue, agents: AgentSet) -> Any:
        """Return the numbers as bools; None if some of them may be invalid as bools."""
        data = value.data
        if not isinstance(data, np.ndarray):
            return bool(data) if data in (0, 1) else None
        if data.dtype == np.bool_:
            return data
        is_invalid = data < 0
        if value.integers & agents:
            is_invalid |= data > 1
        return None if is_invalid.any() else data != 0


class BatchComparison(BatchChain):
    """`a < b <= c`: true if each pair of neighbours is. After a false pair, the rest is not evaluated."""

    def __init__(self, comparison: Comparison, scope: Scope) -> None:
        super().__init__(comparison, scope)
        self.enums = comparison.enums

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return whether all pairs are true."""
        left = self.first.evaluate(run, agents)
        agents = run.drop_failed(agents)
        result: Any = True
        last = len(self.operands) - 1
        for index, operand in enumerate(self.operands):
            if not agents:
                break
            right = operand.evaluate(run, agents)
            agents = run.drop_failed(agents)
            is_true = self._compare(run, agents, index, left, right)
            result = is_true if index == 0 else result & is_true
            if index < last:
                agents = run.drop_failed(agents)
                if isinstance(is_true, np.ndarray):
                    agents &= run.agent_sets.from_mask(is_true)
                elif not is_true:
                    agents = 0
            left = right
        return BatchValue(result if isinstance(result, np.ndarray) else float(result), NUMBER, 0)

    def _compare(
        self, run: ScriptRun, agents: AgentSet, index: int, left: BatchValue, right: BatchValue
    ) -> Any:
        sign = self.tokens[index].type
        first, second = left.data, right.data
        if is_number(left) and is_number(right):
            if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
                if sign in _NEGATED_COMPARISONS:
                    return ~_NEGATED_COMPARISONS[sign](first, second)
                # Integers are equal within EPSILON only if they are the same.
                if left.integers & right.integers & agents == agents:
                    are_equal = first == second
                else:
                    are_equal = np.abs(to_doubles(left) - to_doubles(right)) <= EPSILON
                return are_equal if sign == "==" else ~are_equal
            return compare(sign, float(first), float(second), self.enums)
        if left.form is TEXT and right.form is TEXT and sign in ("==", "!="):
            are_equal = first == second
            if isinstance(are_equal, np.ndarray):
                are_equal = are_equal.astype(np.bool_)
                return are_equal if sign == "==" else ~are_equal
            return are_equal if sign == "==" else not are_equal
        results, _ = run.apply_each(
            agents,
            lambda first, second: compare(sign, first, second, self.enums),
            (left, right),
            lambda message: self.error(index, message),
        )
        return results.astype(np.bool_)


class BatchConditional(BatchExpression):
    """`condition ? a : b`; each branch is evaluated only for the agents that choose it."""

    def __init__(self, conditional: ConditionalExpression, scope: Scope) -> None:
        self.conditional = conditional
        self.condition = compile_expression(conditional.condition, scope)
        self.then = compile_expression(conditional.then, scope)
        self.other = compile_expression(conditional.other, scope)

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the values of the chosen branches."""
        value = self.condition.evaluate(run, agents)
        agents = run.drop_failed(agents)
        agent_sets = run.agent_sets
        if not is_number(value):
            results, agents = run.apply_each(agents, _is_chosen, (value,), self.conditional.error)
            chosen = agent_sets.from_mask(results.astype(np.bool_)) & agents
        elif isinstance(value.data, np.ndarray):
            chosen = agent_sets.from_mask(value.data != 0) & agents
        else:
            chosen = agents if value.data else 0
        rest = agents ^ chosen
        if not rest:
            return self.then.evaluate(run, chosen) if chosen else NO_VALUE
        if not chosen:
            return self.other.evaluate(run, rest)
        then, other = self.then.evaluate(run, chosen), self.other.evaluate(run, rest)
        mask = agent_sets.mask(chosen)
        if then.form is other.form and then.form in (NUMBER, TRUTH, TEXT):
            # Texts stay objects, because the conversion to numpy's own text type would change them.
            first = np.asarray(then.data, dtype=object) if then.form is TEXT else then.data
            integers = then.integers & chosen | other.integers & rest
            return BatchValue(np.where(mask, first, other.data), then.form, integers)
        objects = to_objects(then, agent_sets, chosen)
        np.copyto(objects, to_objects(other, agent_sets, rest), where=agent_sets.mask(rest))
        return BatchValue(objects, OBJECT, 0)


def _is_chosen(value: object) -> bool:
    if isinstance(value, str):
        return leading_float(value) != 0.0
    number = number_of(value)
    if number is None:
        raise ConversionError(f"the condition before '?' is not a number: {value!r}")
    return as_double(number) != 0.0


class BatchAssignment(BatchExpression):
    """`name := value`, and `= += -= *= /=`, which need an entry that exists.

    As in an ordinary script, an entry that holds an integer accepts only integers.
    """

    def __init__(self, assignment: Assignment, scope: Scope) -> None:
        self.assignment = assignment
        self.sign = assignment.operator
        self.copies = scope.copies
        target = assignment.target
        self.target = target if isinstance(target, Name) else None
        self.slot = None if self.target is None else scope.slot(self.target.name)
        self.value = compile_expression(assignment.value, scope)
        literal = assignment.value
        self.writes_integer = isinstance(literal, Literal) and isinstance(literal.value, int)

    def evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the value that was stored."""
        if self.slot is None or self.target is None:
            message = f"only the name of an entry is allowed before '{self.sign}'"
            run.fail(agents, self.assignment.error(message))
            return NO_VALUE
        column = self._column(self.slot, self.target, run, agents)
        agents = run.drop_failed(agents)
        if column is None or not agents:
            return NO_VALUE
        value = self.value.evaluate(run, agents)
        agents = run.drop_failed(agents)
        if not agents:
            return NO_VALUE
        if not column.written and self.writes_integer:
            # BehaviorTree.CPP's scripts have integers of 64 bits.
            column.entry.value_type = None if column.declared.same(INT64) else INT64
        # Most assignments can be stored for all agents at once.
        is_stored = False
        if is_number(value) and (column.values is None or column.form is NUMBER):
            is_stored = self._store_numbers(run, column, value, agents)
        elif value.form is TEXT and self.sign in (":=", "="):
            is_stored = self._store_texts(column, value, agents)
        if not is_stored:
            self._store_each(self.target, run, column, value, agents)
        return column_value(column, run.drop_failed(agents), self.copies)

    def _column(self, slot: Slot, target: Name, run: ScriptRun, agents: AgentSet) -> Column | None:
        """Return the column of the entry; `:=` creates the entry for agents without it."""
        column = slot.column
        missing = agents if column is None else agents ^ (agents & column.exists)
        if not missing:
            return column
        if self.sign != ":=":
            message = f"there is no entry '{target.name}' on the blackboard, and "
            message += f"'{self.sign}' does not create it; ':=' creates an entry"
            run.fail(missing, target.error(message))
            return column
        try:
            column = slot.get_or_create_column()
        except BlackboardError as error:
            run.fail(missing, target.error(str(error)))
            return slot.column
        # The entry exists even if the evaluation of the value fails, as in an ordinary script.
        column.exists |= missing
        return column

    def _store_numbers(self, run: ScriptRun, column: Column, value: BatchValue, agents: AgentSet) -> bool:
        """Store numbers in a column of numbers. Return False if they need a check agent by agent."""
        new = agents ^ (agents & column.written)
        data, form, integers = value
        integers &= agents
        if self.sign not in (":=", "="):
            if new or column.values is None:
                return False
            data = _COMPOUND[self.sign](to_doubles(column.value(0)), to_doubles(value))
            form, integers = NUMBER, 0
        if form is TRUTH:
            # A bool stays a bool only in a new entry; in an entry with a number it becomes a number.
            if new != agents:
                return False
            column.put(agents, data, TRUTH)
            return True
        if isinstance(data, np.ndarray) and data.dtype == np.bool_:
            data = data.astype(np.float64)
        stay_integers = column.integers_among(agents ^ new)
        unchecked = stay_integers ^ (stay_integers & integers)
        if unchecked:
            # Real numbers for entries with integers need no check of each number if all are integral.
            integral = (np.rint(data) == data) & (np.abs(data) <= MAX_EXACT)
            if isinstance(integral, np.ndarray):
                unchecked ^= unchecked & run.agent_sets.from_mask(integral)
            elif integral:
                unchecked = 0
            if unchecked:
                return False
        column.put(agents, data, NUMBER, stay_integers | integers & new)
        return True

    def _store_texts(self, column: Column, value: BatchValue, agents: AgentSet) -> bool:
        """Store texts in a column of texts. Return False if they need a conversion."""
        declared = column.declared
        if (
            agents & column.written != agents
            and declared.strong
            and declared.converts
            and declared.name != "std::string"
        ):
            return False
        if column.values is not None and column.form is not TEXT:
            return False
        column.put(agents, value.data, TEXT)
        return True

    def _store_each(
        self, target: Name, run: ScriptRun, column: Column, value: BatchValue, agents: AgentSet
    ) -> None:
        """Assign agent by agent, as in the ordinary engine."""
        assignment = self.assignment
        objects = to_objects(value, run.agent_sets, agents)
        empty = run.agent_sets.from_mask(np.array([value is None for value in objects])) & agents
        if empty:
            run.fail(empty, assignment.error(f"the operand after '{self.sign}' has no value"))
            agents = run.drop_failed(agents)
        # A single entry stands for the entry of each agent in turn.
        entry = Entry(column.declared)

        def assign(new: object, old: object) -> object:
            if self.sign not in (":=", "="):
                return compound_assigned_value(self.sign, old, new, entry.declared)
            entry.value = old
            return assignment.value_to_store(entry, new)

        results, agents = run.apply_each(
            agents,
            assign,
            (value, BatchValue(column.objects(agents), OBJECT, 0)),
            lambda message: assignment.error(f"cannot assign to '{target.name}': {message}"),
        )
        column.put_objects(agents, results)


def compile_expression(expression: Expression, scope: Scope) -> BatchExpression:
    """Return the counterpart of a parsed *expression* for a batch."""
    if isinstance(expression, Literal):
        return BatchLiteral(expression.value)
    if isinstance(expression, Name):
        number = scope.enums.get(expression.name)
        return BatchName(expression, scope) if number is None else BatchLiteral(float(number))
    if isinstance(expression, UnaryOperation):
        return BatchUnaryOperation(expression, scope)
    if isinstance(expression, OperatorChain):
        return BatchBinaryOperations(expression, scope)
    if isinstance(expression, Comparison):
        return BatchComparison(expression, scope)
    if isinstance(expression, ConditionalExpression):
        return BatchConditional(expression, scope)
    assert isinstance(expression, Assignment)
    return BatchAssignment(expression, scope)


class BatchProgram:
    """A script that was compiled for the blackboard of a node.

    Args:
        node: The node to which errors are attributed.
    """

    def __init__(self, text: str, node: NodeLike) -> None:
        self.node = node
        enums = node.config.enums
        expressions = Parser(text, enums).parse()
        self._statements: list[BatchExpression] = []
        for expression in expressions:
            value = expression.value if isinstance(expression, Assignment) else expression
            scope = Scope(node, enums, copies=_has_assignment(value))
            self._statements.append(compile_expression(expression, scope))
        # numpy warns of a division by zero and of overflow, which are not errors in scripts. The context
        # manager that suppresses the warnings takes time, and scripts that only compare do not need it.
        self._is_quiet = not any(map(_computes, expressions))

    def run(self, agents: AgentSet, doing: str = "ticking") -> AgentSet:
        """Evaluate all statements for *agents*; return the agents for which none has failed."""
        run = ScriptRun(self.node, doing)
        self._evaluate(run, agents)
        return run.drop_failed(agents)

    def split(self, agents: AgentSet) -> tuple[AgentSet, AgentSet]:
        """Return those of *agents* for which the last statement is true, and those for which it is false."""
        run = ScriptRun(self.node, "ticking")
        value = self._evaluate(run, agents)
        agents = run.drop_failed(agents)
        true = select_true(run, value, agents)
        if run.failed:
            true, agents = run.drop_failed(true), run.drop_failed(agents)
        return true, agents ^ true

    def _evaluate(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        """Return the value of the last statement for the agents that have not failed."""
        if self._is_quiet:
            return self._evaluate_statements(run, agents)
        with np.errstate(all="ignore"):
            return self._evaluate_statements(run, agents)

    def _evaluate_statements(self, run: ScriptRun, agents: AgentSet) -> BatchValue:
        value = NO_VALUE
        for statement in self._statements:
            agents = run.drop_failed(agents)
            if not agents:
                break
            value = statement.evaluate(run, agents)
        return value


def select_true(run: ScriptRun, value: BatchValue, agents: AgentSet) -> AgentSet:
    """Return those of *agents* for which *value*, the result of a condition, is true.

    If the value of an agent is neither true nor false, an error is recorded for this agent.
    """
    data, form, integers = value
    agent_sets = run.agent_sets
    if form is NUMBER or form is TRUTH:
        if not isinstance(data, np.ndarray):
            if data == 0 or data == 1 or (data > 0 and not integers & agents):
                return agents if data else 0
        elif data.dtype == np.bool_:
            return agent_sets.from_mask(data) & agents
        else:
            bad = agent_sets.from_mask(data < 0) & agents
            if integers & agents:
                bad |= agent_sets.from_mask(data > 1) & integers & agents
            if not bad:
                return agent_sets.from_mask(data != 0) & agents
    true = 0
    objects = to_objects(value, agent_sets, agents)
    for index in agent_sets.indices(agents):
        try:
            true |= condition_result(objects[index]) << int(index)
        except ScriptError as error:
            run.fail(1 << int(index), error)
    return true


def _computes(expression: Expression) -> bool:
    """Return whether *expression* is more than a comparison of literals and entries."""
    if isinstance(expression, Comparison):
        return any(map(_computes, [expression.first, *expression.operands]))
    return not isinstance(expression, (Literal, Name))


def _has_assignment(expression: Expression) -> bool:
    """Return whether *expression* contains an assignment."""
    if isinstance(expression, Assignment):
        return True
    if isinstance(expression, (OperatorChain, Comparison)):
        return any(map(_has_assignment, [expression.first, *expression.operands]))
    if isinstance(expression, ConditionalExpression):
        return any(map(_has_assignment, [expression.condition, expression.then, expression.other]))
    return isinstance(expression, UnaryOperation) and _has_assignment(expression.operand)
