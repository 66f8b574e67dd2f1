"""The lines that the commands `monitor` and `record` print about the events of a robot."""

from btcore_monitor.events import ConnectionChanged, DataMissed, Event, HooksFound, TransitionsLost


def notice(event: Event) -> str:
    """Return the line to print about *event*, or an empty text if nothing is printed."""
    if isinstance(event, TransitionsLost):
        return f"the transitions {event.first} to {event.last} are lost"
    if isinstance(event, DataMissed):
        between = f" from {event.since / 1e9:.3f} s to {event.t / 1e9:.3f} s" if event.since < event.t else ""
        return f"{event.topic} missing{between}: {event.reason}"
    if isinstance(event, HooksFound):
        return event.warning
    if isinstance(event, ConnectionChanged):
        return event.detail or event.state
    return ""
