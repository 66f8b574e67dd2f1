"""What publishing costs the tree: time added to a tick, and how late ticks begin while clients listen.

    python benchmarks/publishing.py [--pairs 5] [--seconds 2] [--clients 5] [--json]

The tree has 1,000 nodes and is ticked at 100 Hz. In each tick 100 leaves succeed and are reset, which is
200 transitions; the others run on. It is published for Groot 2 and on the scene channel. A client is a
process of its own, with the feed of ``btcore monitor``; the first also asks Groot 2's status 20 times a
second.

Runs with and without come in pairs, one right after the other, and which goes first changes from pair to
pair; figures are medians over the pairs. The ratios are to what is allowed: the median tick alone and half
a millisecond more, the lateness with nobody there and a period more. Times are of the wall clock: the
publisher's thread competes with the tree for the interpreter, and that is to be seen.
"""

import contextlib
import gc
import multiprocessing
import statistics
import time
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.synchronize import Event

import btcore
from btcore.tree.tree import Tree
from btcore_monitor.serve import Publisher, serve
from measure.paired_timing import Spread
from measure.report import Report, arguments, at_most

NODES = 1_000
CHANGING = 100
PERIOD = 0.01
"""s"""
BUDGET = 0.5
"""What publishing may add to a tick (ms)."""
WITHIN = at_most(compiled=1, pure=1)
WARM_UP = 20
"""Ticks of a run that don't count."""
CLIENTS_WITHIN = 30.0
STATUS_EVERY = 0.05
"""s; between two questions for all statuses, as a window asks them."""


@dataclass(frozen=True, slots=True)
class Run:
    """What the ticks of one run took, and how late they began (both ms)."""

    durations: list[float]
    lateness: list[float]


def document() -> str:
    """A tree of NODES nodes, of which CHANGING change in each tick."""
    changing = "<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>"
    running = '<Sleep msec="100000000"/>'
    groups = 10
    inside = [changing] * (CHANGING // groups)
    # a group has its Parallel, two nodes for each that changes, and the rest
    inside += [running] * ((NODES - 1) // groups - 1 - 2 * len(inside))
    group = f'<Parallel success_count="-1" failure_count="1">{"".join(inside)}</Parallel>'
    made = groups * (1 + 2 * (CHANGING // groups) + inside.count(running))
    body = group * groups + running * (NODES - 1 - made)
    return (
        '<root BTCPP_format="4"><BehaviorTree ID="Main">'
        f'<Parallel success_count="-1" failure_count="1">{body}</Parallel></BehaviorTree></root>'
    )


def paced(tree: Tree, seconds: float) -> Run:
    """Tick *tree* at its rate for *seconds*."""
    durations, lateness = [], []
    gc.collect()
    due = time.perf_counter()
    for tick in range(WARM_UP + round(seconds / PERIOD)):
        due += PERIOD
        time.sleep(max(0.0, due - time.perf_counter()))
        begin = time.perf_counter()
        tree.tick_exactly_once()
        end = time.perf_counter()
        if tick >= WARM_UP:
            durations.append(1e3 * (end - begin))
            lateness.append(1e3 * (begin - due))
        # a tick that was missed is not made up for
        due = max(due, end - PERIOD)
    return Run(durations, lateness)


def listen(port: int, asks_status: bool, stop: Event) -> None:
    """What a client's process does until *stop*."""
    import zmq

    from btcore_monitor.watch.feed import Feed
    from btcore_monitor.wire.groot2 import Request, encode_request

    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    question = None
    next_question = 0.0
    with contextlib.closing(Feed(f"127.0.0.1:{port}")) as feed:
        while not stop.is_set():
            feed.poll(STATUS_EVERY)
            now = time.monotonic()
            if not asks_status or now < next_question:
                continue
            next_question = now + STATUS_EVERY
            if question is None:
                question = context.socket(zmq.REQ)
                question.setsockopt(zmq.LINGER, 0)
                question.connect(f"tcp://127.0.0.1:{port}")
            question.send_multipart(encode_request(Request.STATUS, 1))
            if question.poll(1000):
                question.recv_multipart()
            else:
                question.close()
                question = None
    if question is not None:
        question.close()
    context.term()


@contextlib.contextmanager
def clients(count: int, port: int) -> Iterator[None]:
    """*count* clients of whoever publishes at *port*."""
    spawn = multiprocessing.get_context("spawn")
    stop = spawn.Event()
    processes = [spawn.Process(target=listen, args=(port, index == 0, stop)) for index in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        stop.set()
        for process in processes:
            process.join(10)
            if process.is_alive():
                process.kill()
                process.join()


def free_port() -> int:
    """A port that is free with the two after it."""
    with contextlib.closing(serve(btcore.loads(document()))) as found:
        return found.port


def published(tree: Tree, port: int, count: int) -> Publisher:
    """*tree* published at *port*, with *count* clients there."""
    publisher = serve(tree, groot2=port, grace=0.0)
    if not publisher.wait_for_clients(count, CLIENTS_WITHIN):
        publisher.close()
        raise SystemExit(f"only {publisher.clients} of {count} clients came within {CLIENTS_WITHIN:g} s")
    return publisher


def percentile(values: list[float], share: float) -> float:
    """The value that *share* of *values* don't exceed."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def cost(report: Report, port: int, seconds: float) -> None:
    """What publishing adds to a tick."""
    plain, heard = [], []
    with clients(1, port):
        for pair in range(report.pairs):
            for publishes in (True, False) if pair % 2 else (False, True):
                tree = btcore.loads(document())
                if publishes:
                    with published(tree, port, 1):
                        heard.append(statistics.median(paced(tree, seconds).durations))
                else:
                    plain.append(statistics.median(paced(tree, seconds).durations))
    tell(report, f"a tick: published / alone + {BUDGET:g} ms", heard, plain, BUDGET)


def lateness(report: Report, port: int, seconds: float, count: int) -> None:
    """How late ticks begin with *count* clients, and with none."""
    alone: list[float] = []
    together: list[float] = []
    for pair in range(report.pairs):
        for listening in (count, 0) if pair % 2 else (0, count):
            tree = btcore.loads(document())
            with clients(listening, port), published(tree, port, listening):
                late = percentile(paced(tree, seconds).lateness, 0.99)
                (together if listening else alone).append(late)
    what = f"lateness, 99th percentile: {count} client{'s' * (count > 1)} / none + a period"
    tell(report, what, together, alone, 1e3 * PERIOD)


def tell(report: Report, what: str, published: list[float], alone: list[float], budget: float) -> None:
    """Report the times (ms) of runs *published* over those *alone*, each of its pair, and *budget* more."""
    pairs = list(zip(published, alone, strict=True))
    figures = {
        "alone": f"{statistics.median(alone):.3f} ms",
        "published": f"{statistics.median(published):.3f} ms",
        "added": f"{statistics.median(one - other for one, other in pairs):.3f} ms",
    }
    report.add(what, Spread.of([one / (other + budget) for one, other in pairs]), WITHIN, figures)


def main() -> None:
    """Measure and print."""
    parser = arguments(__doc__ or "", pairs=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="how long a run is")
    parser.add_argument("--clients", type=int, default=5, help="for the lateness")
    given = parser.parse_args()
    nodes = len(btcore.loads(document()).nodes)
    if given.quick:
        given.seconds, given.clients = 0.1, 1
    question = (
        f"What publishing costs: {nodes:,} nodes at {1 / PERIOD:g} Hz, of which {CHANGING} change each tick; "
        f"one client, for the lateness {given.clients}"
    )
    report = Report("publishing", question, given.pairs)
    port = free_port()
    cost(report, port, given.seconds)
    lateness(report, port, given.seconds, given.clients)
    report.output(given.json)


if __name__ == "__main__":
    main()
