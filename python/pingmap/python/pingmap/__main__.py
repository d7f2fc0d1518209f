"""The program ``pingmap``."""

import signal
import sys

from . import _pingmap


def main() -> int:
    """Runs the program with the arguments of the process. Returns the exit status."""
    # The program ends at Ctrl-C as the compiled program does.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _pingmap.main(sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
