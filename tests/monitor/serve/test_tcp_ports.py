"""Publishing at unavailable ports: the error names a solution, and all ports are released."""

import pytest
import zmq

from btcore_monitor.serve import PortInUseError, ServeError, serve

pytestmark = pytest.mark.usefixtures("no_threads_left")


def test_a_port_in_use_is_reported_with_alternatives(sample):
    with serve(sample, groot2_port=0) as first, pytest.raises(PortInUseError) as raised:
        serve(sample, groot2_port=first.port)
    assert str(raised.value) == (
        f"port {first.port} is in use: choose another port with --port, or a free port with --port 0"
    )
    assert raised.value.port == first.port


@pytest.mark.parametrize(("offset", "bind"), [(1, "127.0.0.1"), (2, "127.0.0.1"), (1, "*")])
def test_a_neighbour_port_in_use_is_reported_and_lower_ports_are_released(sample, offset, bind):
    with serve(sample, groot2_port=0) as publisher:
        port = publisher.port
    with zmq.Context() as context, context.socket(zmq.REP) as other:
        other.bind(f"tcp://127.0.0.1:{port + offset}")
        with pytest.raises(
            PortInUseError, match=rf"port {port + offset} is in use \({port} to {port + 2} are needed"
        ):
            serve(sample, groot2_port=port, bind=bind)
    with serve(sample, groot2_port=port) as publisher:
        assert publisher.port == port


def test_free_ports_are_chosen_for_0(sample, endless):
    with serve(sample, groot2_port=0) as first, serve(endless, groot2_port=0) as second:
        assert abs(first.port - second.port) >= 3
        assert first.address == f"tcp://127.0.0.1:{first.port}"


def test_a_publisher_without_a_protocol_is_rejected(sample):
    with pytest.raises(ServeError, match="groot2_port and groot1_port are None"):
        serve(sample, groot2_port=None)


def test_an_unknown_interface_is_reported(sample):
    with pytest.raises(ServeError, match=r"cannot listen at '203\.0\.113\.9'.*--bind"):
        serve(sample, groot2_port=0, bind="203.0.113.9")


@pytest.mark.parametrize("port", [-1, 65534, 70000])
def test_a_port_without_two_above_it_is_out_of_range(sample, port):
    with pytest.raises(ServeError, match="out of range"):
        serve(sample, groot2_port=port)


def test_all_interfaces_are_reached_on_this_machine_by_loopback(sample):
    with serve(sample, groot2_port=0, bind="*") as publisher:
        assert publisher.address == f"tcp://127.0.0.1:{publisher.port}"
