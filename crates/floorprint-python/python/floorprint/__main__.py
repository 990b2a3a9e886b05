"""The command line: ``floorprint``, or ``python -m floorprint``."""

import signal
import sys

from floorprint import _native


def main() -> int:
    """Runs the command line; gives its exit code."""
    # The program hears Ctrl-C itself.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native.main([sys.executable, "-m", "floorprint"], sys.argv[1:])


if __name__ == "__main__":
    sys.exit(main())
