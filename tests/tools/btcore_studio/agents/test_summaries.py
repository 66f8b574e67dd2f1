"""What agents read of a log and of a proof."""

from btcore_studio.agents.summaries import answer_of, reason_of


def test_answers_have_no_empty_values_and_keep_zeros() -> None:
    leaf = {"node": "Move::2", "result": "RUNNING", "written": {}}
    tick = {"time": 0.0, "leaves": [leaf], "halted": [], "running": ["Move::2"], "result": None, "error": ""}
    question = {"question": "the tree ends", "answer": "refuted", "detail": "", "vacuous": False, "cycle": 0}
    assert answer_of({**question, "counterexample": [tick]}) == {
        "question": "the tree ends",
        "answer": "refuted",
        "cycle": 0,
        "counterexample": [
            {"time": 0.0, "leaves": [{"node": "Move::2", "result": "RUNNING"}], "running": ["Move::2"]}
        ],
    }
    proved = {"question": "A before B", "answer": "proved", "vacuous": True, "cycle": None}
    assert answer_of(proved)["answer"] == "proved, vacuously: its premise never holds"


def test_reason_names_children_that_did_not_complete() -> None:
    cause = {"node": "late", "id": "Timeout", "type": "DECORATOR", "time_s": 1.5, "ports": {"msec": "1500"}}
    assert reason_of({**cause, "children": {"OpenDoor::3": None}}, ["warning: other: no"]) == (
        'the decorator <Timeout> with msec="1500" returned FAILURE at 1.5 s although none of its children '
        "failed: OpenDoor::3 did not complete"
    )
