"""The program ``pingmap``."""

import signal
import sys

from . import _pingmap
from ._options import with_program


def main() -> int:
    """Runs the program with the arguments of the process. Returns the exit status."""
    # The program ends at Ctrl-C as the compiled program does.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        return _pingmap.main(with_program(sys.argv[1:]))
    except ValueError as error:
        print(f"pingmap: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
