"""The flag with which Ctrl-C in the console does not end a child process on Windows.

Elsewhere the argument `start_new_session` of `subprocess.Popen` has this effect, which Windows ignores.
"""

import subprocess
import sys

NEW_PROCESS_GROUP = 0
"""The argument `creationflags` of `subprocess.Popen`."""

if sys.platform == "win32":
    NEW_PROCESS_GROUP = subprocess.CREATE_NEW_PROCESS_GROUP
