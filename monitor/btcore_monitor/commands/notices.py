"""The lines that the commands `monitor` and `record` print about the events of a robot."""

from btcore_monitor.events import ConnectionEvent, Event, HooksEvent, LostTransitionsEvent, MissingDataEvent


def format_notice(event: Event) -> str:
    """Return the line to print about *event*, or an empty text if nothing is printed."""
    if isinstance(event, LostTransitionsEvent):
        return f"the transitions {event.first} to {event.last} are lost"
    if isinstance(event, MissingDataEvent):
        between = (
            f" from {event.since / 1e9:.3f} s to {event.stamp / 1e9:.3f} s"
            if event.since < event.stamp
            else ""
        )
        return f"{event.kind} missing{between}: {event.reason}"
    if isinstance(event, HooksEvent):
        return event.warning
    if isinstance(event, ConnectionEvent):
        return event.detail or event.state
    return ""
