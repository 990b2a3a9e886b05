"""The process that solves one log of a fleet: ``python -m floorprint._worker QUESTION``.

It is started for each log, so that it imports no more than it needs.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import threading

from floorprint._config import restored
from floorprint._errors import Error
from floorprint._run import solve


def work() -> None:
    """Solves the log that its argument names, and answers on stdout."""
    log, path, layers, folder, threads, scratch = json.loads(sys.argv[1])

    def end_with_who_asked() -> None:
        # Its end of the pipe closes when it dies, however it does.
        sys.stdin.read()
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=end_with_who_asked, daemon=True).start()
    try:
        result = solve(path, restored(*layers), threads=threads, address=log)
        if folder is not None:
            # What stands there is of an attempt whose outcome was lost, or of an earlier call.
            result.save(folder, replace=True)
        json.dump([result.report, None], sys.stdout)
    except (Error, OSError) as error:
        json.dump([None, str(error)], sys.stdout)


if __name__ == "__main__":
    work()
