"""Proofs about the trees of XML files: `prove`, `assert_proved` and `assert_holds_in_run`."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from os import PathLike
from pathlib import Path

from btcore.clock import Clock
from btcore.loading.instantiate import instantiate
from btcore.logs.formats import open_log
from btcore.registry.registry import Registry
from btcore.tree.drawing import to_text
from btcore.tree.tree import Tree
from btcore.xml.models.model_file import add_explicit_nodes, add_models
from btcore.xml.plan.plan import Plans, plan_document
from btcore.xml.read.read import parse_file, read
from btcore_proof.answer_text import lines_of_answer
from btcore_proof.counterexample import TreeMaker
from btcore_proof.declarations import Declarations, declarations_beside, read_declarations
from btcore_proof.model_leaves import Choices, ModelPrompt, with_model_leaves
from btcore_proof.outcome_replay import (
    ReplayChoices,
    TickOutcomes,
    recorded_outcomes,
    replay_outcomes,
)
from btcore_proof.propositions import parse_question
from btcore_proof.prover import PROVED, Answer, Prover, Report, beginnings_of, write_entries
from btcore_proof.search import MEMORY_MB, SearchLimits

File = str | PathLike[str]


def prove(
    file: File,
    *questions: str,
    nodes: Registry | None = None,
    models: Sequence[File] = (),
    tree: str | None = None,
    format: int | None = None,
    given: Sequence[str] = (),
    declarations: File | None = None,
    ticks: int | None = None,
    memory: int = MEMORY_MB,
    jobs: int = 1,
    seconds: float | None = None,
    instant_leaves: bool = False,
) -> Report:
    """Answer the standard questions, and others, about all possible runs of a tree.

    Leaves with code are replaced by models, see the page on proofs. The declarations in `FILE.proof.toml`
    beside the tree's file are read.

    Args:
        file: The XML file of the tree.
        questions: Further questions: `never A`, `A leads to B`, `A leads to B within 5 ticks`, `A before B`.
        nodes: The nodes that the tree may use; default `Registry.standard`.
        models: TreeNodesModel files, whose nodes need no code.
        tree: The ID of the tree; default the main tree of the file.
        format: The XML format, 3 or 4; default the format of the file.
        given: The keys of the entries that the program sets before the first tick.
        declarations: A file with declarations; default the file beside the tree's file, if there is one.
        ticks: The greatest number of ticks of a run; default no limit.
        memory: The memory (MB) at which the search ends.
        jobs: The number of processes of a long search; without effect on other systems than Linux.
        seconds: The time (s) after which the search ends with the answers so far; default no limit.
        instant_leaves: Whether leaves take no time. By default any time may pass within a tick, so that the
            deadlines of a tick may be set at different times.

    Returns:
        The answers. Each is `proved`, `refuted` or `unknown`; also unknown for a question that names a node
        that the tree does not have.

    Raises:
        TreeError: The tree or a model has errors.
        ModelError: A declaration is invalid.
        QuestionError: A text is not a question.
        NodeError: The state of a node cannot be saved.

    Examples:
        >>> from pathlib import Path
        >>> from btcore_proof import prove
        >>> xml = '''<root BTCPP_format="4"><BehaviorTree ID="Main">
        ...   <Sequence> <Condition ID="DoorOpen"/> <Action ID="Drive"/> </Sequence>
        ... </BehaviorTree></root>'''
        >>> _ = Path("drive.xml").write_text(xml)
        >>> questions = ["DoorOpen is SUCCESS before Drive", "never Drive"]
        >>> report = prove("drive.xml", *questions, models=["drive.xml"])
        >>> [answer.answer for answer in report.answers[-2:]]
        ['proved', 'refuted']
        >>> run = report.answers[-1].counterexample
        >>> [(leaf.name, leaf.result.name) for leaf in run.ticks[0].leaves]
        [('DoorOpen', 'SUCCESS'), ('Drive', 'RUNNING')]
    """
    declared = declarations_of(Path(file), declarations)
    plans = _plans(file, nodes, models, tree, format, declared)
    prover = prover_of(plans, questions, declared, given, instant_leaves)
    return prover.answer(SearchLimits(ticks, seconds, memory, jobs))


def assert_proved(report: Report) -> None:
    """Assert that everything in a report of `prove` is proved.

    Raises:
        AssertionError: A question is refuted or unknown; the message contains the counterexamples.

    Examples:
        >>> from pathlib import Path
        >>> from btcore_proof import assert_proved, prove
        >>> xml = '''<root BTCPP_format="4"><BehaviorTree ID="Main">
        ...   <Sequence> <Action ID="Grasp"/> <Action ID="Lift"/> </Sequence>
        ... </BehaviorTree></root>'''
        >>> _ = Path("pick.xml").write_text(xml)
        >>> assert_proved(prove("pick.xml", "Grasp is SUCCESS before Lift", models=["pick.xml"]))
    """
    open_answers = [answer for answer in report.answers if answer.answer != PROVED]
    if open_answers:
        lines = [line for answer in open_answers for line in lines_of_answer(answer)]
        raise AssertionError(f"not everything is proved:\n{to_text(lines)}")


def assert_holds_in_run(
    file: File,
    question: str,
    recording: File,
    *,
    cycle: tuple[int, float] | None = None,
    nodes: Registry | None = None,
    models: Sequence[File] = (),
    tree: str | None = None,
    format: int | None = None,
    declarations: File | None = None,
) -> None:
    """Run a tree with recorded outcomes of its leaves, and assert that the run does not violate a question.

    `btcore prove --save` writes tests with this assertion. Model leaves do what was recorded for the leaves
    of the same name. A leaf that is ticked in a tick without an outcome for it takes its next outcome. After
    its last outcome, it repeats this outcome, unless that is RUNNING. In all other cases, it takes the first
    result of its model. The run ends when the tree ends.

    Args:
        file: The XML file of the tree.
        question: The question, as in `prove`; or a standard question.
        recording: The file of the recording.
        cycle: The index of the tick from which the ticks are repeated, and the duration of the cycle (s).
        nodes: As in `prove`, like all following arguments.
        models: As in `prove`.
        tree: As in `prove`.
        format: As in `prove`.
        declarations: As in `prove`.

    Raises:
        AssertionError: The run violates the question.
        OutcomesError: The tree has no leaf of a recorded name, or a leaf has raised an exception.
        LogError: The recording cannot be read.
        TreeError: The tree or a model has errors.
        ModelError: A declaration is invalid.
        QuestionError: The question is invalid.

    Examples:
        >>> from pathlib import Path
        >>> import btcore
        >>> from btcore.logs import open_log
        >>> from btcore_proof import assert_holds_in_run
        >>> xml = '''<root BTCPP_format="4"><BehaviorTree ID="Main">
        ...   <ReactiveSequence> <Condition ID="PathFree"/> <Action ID="Drive"/> </ReactiveSequence>
        ... </BehaviorTree></root>'''
        >>> _ = Path("drive.xml").write_text(xml)
        >>> @btcore.condition
        ... def path_free() -> bool:
        ...     return True
        >>> @btcore.action
        ... def drive() -> bool:
        ...     return True
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(path_free, drive)
        >>> tree = btcore.load("drive.xml", nodes=nodes)
        >>> with open_log(tree, "drive.btrec.txt"):
        ...     _ = tree.tick_once()
        >>> question = "never Drive & PathFree is FAILURE"
        >>> assert_holds_in_run("drive.xml", question, "drive.btrec.txt", nodes=nodes)
    """
    __tracebackhide__ = True  # pytest shows the test instead of this function
    ticks, entries = recorded_outcomes(Path(recording))
    declared = declarations_of(Path(file), declarations)
    plans = _plans(file, nodes, models, tree, format, declared)
    fault = fault_in_run(plans, question, ticks, cycle, entries, declared)
    if fault is not None:
        raise AssertionError(f"{question}: {fault}")


def declarations_of(file: Path, declarations: File | None) -> Declarations:
    """Return the declarations in the file *declarations*, or in the file beside the tree's file.

    Raises:
        ModelError: The file cannot be read, or is invalid.
    """
    return declarations_beside(file) if declarations is None else read_declarations(Path(declarations))


def prover_of(
    plans: Plans,
    questions: Sequence[str],
    declared: Declarations,
    given: Sequence[str] = (),
    instant_leaves: bool = False,
) -> Prover:
    """Return the prover for a tree.

    Args:
        plans: The plans of the tree, without errors: model leaves replace leaves with code.
        questions: The questions, in addition to the declared ones.
        declared: The declarations.
        given: The keys that the program sets before the first tick, in addition to the declared ones.
        instant_leaves: As in `prove`.

    Raises:
        ModelError: A declaration is invalid.
        QuestionError: A text is not a question.
        NodeError: The state of a node cannot be saved.
    """
    parsed = [parse_question(text) for text in [*questions, *declared.questions.values()]]
    keys = [*dict.fromkeys([*declared.given, *given])]
    return Prover(_maker(plans, {}), parsed, declared.entries, keys, instant_leaves)


def fault_in_run(
    plans: Plans,
    question: str,
    ticks: Sequence[TickOutcomes],
    cycle: tuple[int, float] | None,
    set_before: Mapping[str, str],
    declared: Declarations,
) -> str | None:
    """Return how a run with given outcomes violates a question, or None.

    Args:
        plans: As in `prover_of`.
        question: As in `assert_holds_in_run`.
        ticks: The outcomes in each tick.
        cycle: As in `assert_holds_in_run`.
        set_before: The values of the entries that the program sets before the first tick, as texts; `?` is a
            value that is not known.
        declared: The declarations.

    Raises:
        OutcomesError: The outcomes of a leaf are invalid.
        QuestionError: The question is invalid.
    """
    choices = ReplayChoices(ticks, None if cycle is None else cycle[0], declared.entries)
    return replay_outcomes(_maker(plans, set_before), choices, ticks, question, cycle)


def record_counterexample(plans: Plans, answer: Answer, declared: Declarations, file: Path) -> bool:
    """Run a counterexample again, and record it.

    Args:
        plans: As in `prover_of`.
        answer: The answer, which has a counterexample.
        declared: The declarations.
        file: The file of the recording.

    Returns:
        Whether a test can repeat the counterexample by the outcomes of the leaves in the recording.
    """
    shown = answer.counterexample
    assert shown is not None
    assert shown.run is not None
    with ExitStack() as recordings:
        shown.run.run(lambda tree: recordings.enter_context(open_log(tree, file)))
    ticks, entries = recorded_outcomes(file)
    return fault_in_run(plans, answer.question, ticks, shown.recorded_cycle, entries, declared) is not None


def _maker(plans: Plans, set_before: Mapping[str, str]) -> TreeMaker:
    known = {key: (text,) for key, text in set_before.items() if text != "?"}

    def make(choices: Choices, clock: Clock) -> Tree:
        resources = [choices, ModelPrompt(choices)]
        tree = instantiate(plans, resources, clock=clock)
        (values,) = beginnings_of(tree, choices, known, list(set_before))
        write_entries(tree, values)
        return tree

    return make


def _plans(
    file: File,
    nodes: Registry | None,
    models: Sequence[File],
    tree: str | None,
    format: int | None,
    declared: Declarations,
) -> Plans:
    """Read and plan a tree with model leaves."""
    document = parse_file(file)
    available = Registry.standard() if nodes is None else nodes.copy()
    for model in models:
        add_models(available, model)
    if models:
        add_explicit_nodes(available, read(document).documents)
    leaves = with_model_leaves(available, declared.leaves)
    plans = plan_document(document, leaves, tree, format)
    plans.diagnostics.raise_errors()
    return plans
