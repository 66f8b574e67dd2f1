"""The cost of publishing: the time added to a tick, and the delay of ticks while clients are connected.

    python benchmarks/publishing.py [--pairs 5] [--seconds 2] [--clients 5] [--quick] [--json]

The tree has 1,000 nodes and is ticked at 100 Hz. In each tick 100 leaves succeed and are reset, which is 200
transitions; the other leaves stay RUNNING. The tree is published for Groot 2 and on the run channel. A
client is a separate process with the feed of ``btcore monitor``; the first client also requests the status by
Groot 2's protocol 20 times a second. The lateness of a tick is the delay of its start after the scheduled
time.

Runs with and without publishing are made in pairs, directly after each other and in alternating order; values
are medians over the pairs. The ratios are relative to the permitted values: the median time of a tick without
publishing plus half a millisecond, and the lateness without clients plus a period. Times are wall-clock
times, because the publisher's thread competes with the tree for the interpreter.
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
from measure.paired_timing import Spread, percentile
from measure.report import Report, at_most, create_parser

NODES = 1_000
CHANGING = 100
PERIOD = 0.01  # s
BUDGET = 0.5  # ms, that publishing may add to a tick
WITHIN = at_most(compiled=1, pure=1)
WARM_UP = 20  # ticks that do not count
CLIENTS_TIMEOUT = 30.0  # s
STATUS_INTERVAL = 0.05  # s between two requests for all statuses, as in Groot's window


@dataclass(frozen=True, slots=True)
class Run:
    """The durations of the ticks of a run (ms), and the delays of the ticks after the schedule (ms)."""

    durations: list[float]
    lateness: list[float]


def document() -> str:
    """Return an XML document of NODES nodes, among them CHANGING leaves that change in each tick."""
    changing = "<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>"
    running = '<Sleep msec="100000000"/>'
    groups = 10
    inside = [changing] * (CHANGING // groups)
    # A group consists of a Parallel, two nodes for each leaf that changes, and leaves that stay RUNNING.
    inside += [running] * ((NODES - 1) // groups - 1 - 2 * len(inside))
    group = f'<Parallel success_count="-1" failure_count="1">{"".join(inside)}</Parallel>'
    transitions = groups * (1 + 2 * (CHANGING // groups) + inside.count(running))
    body = group * groups + running * (NODES - 1 - transitions)
    return (
        '<root BTCPP_format="4"><BehaviorTree ID="Main">'
        f'<Parallel success_count="-1" failure_count="1">{body}</Parallel></BehaviorTree></root>'
    )


def run(tree: Tree, seconds: float) -> Run:
    """Tick *tree* every PERIOD for *seconds* (s), and return the times of the ticks."""
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
        # Missed ticks are not repeated.
        due = max(due, end - PERIOD)
    return Run(durations, lateness)


def run_client(port: int, requests_status: bool, stop: Event) -> None:
    """Receive the data published at *port* until *stop*. If *requests_status*, also request statuses."""
    import zmq

    from btcore_monitor.watch.feed import Feed
    from btcore_monitor.wire.groot2 import Request, encode_request

    next_request = 0.0
    with (
        zmq.Context() as context,
        context.socket(zmq.REQ) as socket,
        contextlib.closing(Feed(f"127.0.0.1:{port}")) as feed,
    ):
        # The publisher changes between runs: a request without a reply must not block the next request.
        for option, value in ((zmq.REQ_RELAXED, 1), (zmq.REQ_CORRELATE, 1), (zmq.LINGER, 0)):
            socket.setsockopt(option, value)
        socket.connect(f"tcp://127.0.0.1:{port}")
        while not stop.is_set():
            feed.poll(STATUS_INTERVAL)
            if requests_status and time.monotonic() >= next_request:
                next_request = time.monotonic() + STATUS_INTERVAL
                socket.send_multipart(encode_request(Request.STATUS, 1))
                if socket.poll(1000):
                    socket.recv_multipart()


@contextlib.contextmanager
def start_clients(count: int, port: int) -> Iterator[None]:
    """Start *count* clients of the publisher at *port*, and end them at the end of the context."""
    spawn = multiprocessing.get_context("spawn")
    stop = spawn.Event()
    processes = [spawn.Process(target=run_client, args=(port, index == 0, stop)) for index in range(count)]
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
    """Return the first of three successive free TCP ports."""
    with contextlib.closing(serve(btcore.loads(document()))) as publisher:
        return publisher.port


def publish_and_wait(tree: Tree, port: int, count: int) -> Publisher:
    """Publish *tree* at *port*, wait until *count* clients are connected, and return the publisher."""
    publisher = serve(tree, groot2_port=port, grace=0.0)
    if not publisher.wait_for_clients(count, CLIENTS_TIMEOUT):
        publisher.close()
        connected = f"{publisher.client_count} of {count} clients"
        raise SystemExit(f"only {connected} connected within {CLIENTS_TIMEOUT:g} s")
    return publisher


def add_cost_row(report: Report, port: int, seconds: float) -> None:
    """Add a row about the time that publishing adds to a tick."""
    alone, together = [], []
    with start_clients(1, port):
        for pair in range(report.pairs):
            for publishes in (True, False) if pair % 2 else (False, True):
                tree = btcore.loads(document())
                if publishes:
                    with publish_and_wait(tree, port, 1):
                        together.append(statistics.median(run(tree, seconds).durations))
                else:
                    alone.append(statistics.median(run(tree, seconds).durations))
    add_row(report, f"a tick: published / alone + {BUDGET:g} ms", together, alone, BUDGET)


def add_lateness_row(report: Report, port: int, seconds: float, count: int) -> None:
    """Add a row about the lateness of ticks with *count* clients, and without clients."""
    alone: list[float] = []
    together: list[float] = []
    for pair in range(report.pairs):
        for connected in (count, 0) if pair % 2 else (0, count):
            tree = btcore.loads(document())
            with start_clients(connected, port), publish_and_wait(tree, port, connected):
                late = percentile(run(tree, seconds).lateness, 0.99)
                (together if connected else alone).append(late)
    label = f"lateness, 99th percentile: {count} client{'s' * (count > 1)} / none + a period"
    add_row(report, label, together, alone, 1e3 * PERIOD)


def add_row(report: Report, label: str, published: list[float], alone: list[float], budget: float) -> None:
    """Add a row: the times *published* divided by *alone* of the same pair plus *budget* (all in ms)."""
    pairs = list(zip(published, alone, strict=True))
    figures = {
        "alone": f"{statistics.median(alone):.3f} ms",
        "published": f"{statistics.median(published):.3f} ms",
        "added": f"{statistics.median(with_it - without for with_it, without in pairs):.3f} ms",
    }
    ratio = Spread.of([with_it / (without + budget) for with_it, without in pairs])
    report.add(label, ratio, WITHIN, figures)


def main() -> None:
    """Run the benchmark."""
    parser = create_parser(__doc__ or "", pairs=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="duration of a run")
    parser.add_argument("--clients", type=int, default=5, help="number of clients for the lateness")
    options = parser.parse_args()
    nodes = len(btcore.loads(document()).nodes)
    if options.quick:
        options.seconds, options.clients = 0.1, 1
    question = (
        f"The cost of publishing: {nodes:,} nodes at {1 / PERIOD:g} Hz, {CHANGING} change in each tick; "
        f"1 client, for the lateness {options.clients}"
    )
    report = Report("publishing", question, options.pairs)
    port = free_port()  # the same for all runs, since clients may outlive a publisher
    add_cost_row(report, port, options.seconds)
    add_lateness_row(report, port, options.seconds, options.clients)
    report.output(options.json)


if __name__ == "__main__":
    main()
