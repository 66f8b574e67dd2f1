"""``python -m monitor`` is ``btcore monitor``."""

from monitor.commands import monitor

if __name__ == "__main__":
    monitor(prog_name="btcore monitor")
