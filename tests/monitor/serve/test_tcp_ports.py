"""Publishing at unavailable ports: the error names a solution, and all ports are released."""

import pytest
import zmq

import btcore
from btcore_monitor.serve import PortInUseError, ServeError, serve

pytestmark = pytest.mark.usefixtures("no_threads_left")
PORTS = {"groot2": "port", "groot1": "groot1_port"}
"""The attributes of a publisher with the first ports of the protocols."""


def test_a_port_in_use_is_reported_with_alternatives(sample: btcore.Tree) -> None:
    with serve(sample, groot2_port=0) as first, pytest.raises(PortInUseError) as raised:
        serve(sample, groot2_port=first.port)
    assert str(raised.value) == (
        f"port {first.port} is in use: choose another port with --port, or a free port with --port 0"
    )
    assert raised.value.port == first.port


@pytest.mark.parametrize(
    ("protocols", "offset", "bind", "needed"),
    [
        (("groot2",), 1, "127.0.0.1", r" \({0} to {2} are needed"),
        (("groot2",), 2, "127.0.0.1", r" \({0} to {2} are needed"),
        (("groot2",), 1, "*", r" \({0} to {2} are needed"),
        (("groot1",), 0, "127.0.0.1", ""),
        (("groot1",), 1, "127.0.0.1", ""),
        (("groot1",), 3, "127.0.0.1", ""),
        (("groot2", "groot1"), 0, "127.0.0.1", ""),
    ],
)
def test_a_port_in_use_is_reported_and_the_other_ports_are_released(
    sample: btcore.Tree, protocols: tuple[str, str] | tuple[str], offset: int, bind: str, needed: str
) -> None:
    with serve(sample, **{"groot2_port": None, **{f"{name}_port": 0 for name in protocols}}) as publisher:
        ports = {
            "groot2_port": None,
            **{f"{name}_port": getattr(publisher, PORTS[name]) for name in protocols},
        }
    first = ports[f"{protocols[-1]}_port"]
    message = f"port {first + offset} is in use{needed.format(first, 0, first + 2)}"
    with zmq.Context() as context, context.socket(zmq.REP) as other:
        other.bind(f"tcp://127.0.0.1:{first + offset}")
        with pytest.raises(PortInUseError, match=message):
            serve(sample, **ports, bind=bind)
    with serve(sample, **ports) as publisher:
        assert getattr(publisher, PORTS[protocols[0]]) == ports[f"{protocols[0]}_port"]


def test_a_publisher_without_a_protocol_is_rejected(sample: btcore.Tree) -> None:
    with pytest.raises(ServeError, match="groot2_port and groot1_port are None"):
        serve(sample, groot2_port=None)


def test_an_unknown_interface_is_reported(sample: btcore.Tree) -> None:
    with pytest.raises(ServeError, match=r"cannot listen at '203\.0\.113\.9'.*--bind"):
        serve(sample, groot2_port=0, bind="203.0.113.9")


@pytest.mark.parametrize(
    ("ports", "message"),
    [
        ({"groot2_port": -1}, "out of range"),
        ({"groot2_port": 65534}, "out of range"),
        ({"groot2_port": None, "groot1_port": 65533}, "choose one from 1 to 65532"),
    ],
)
def test_a_port_without_free_ports_above_it_is_out_of_range(
    sample: btcore.Tree, ports: dict[str, int | None] | dict[str, int], message: str
) -> None:
    with pytest.raises(ServeError, match=message):
        serve(sample, **ports)


def test_all_interfaces_are_reached_on_this_machine_by_loopback(sample: btcore.Tree) -> None:
    with serve(sample, groot2_port=0, bind="*") as publisher:
        assert publisher.address == f"tcp://127.0.0.1:{publisher.port}"
