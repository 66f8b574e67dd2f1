"""What agents read of a log and of a proof."""

from btcore_studio.agents.summaries import answer_of


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
