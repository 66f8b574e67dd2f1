"""`python -m btcore_monitor` is `btcore monitor`."""

import sys

from btcore.__main__ import main

if __name__ == "__main__":
    sys.argv.insert(1, "monitor")
    main()
