"""One file per question; `python -m scenarios.NAME --help` is its manual.

Who interrupts while the libraries are still being imported is answered as later on.
"""

import os
import sys
from types import TracebackType

INTERRUPTED = 130
SAYS = "interrupted; run the same command again, what was finished is kept"


def _hook(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    if issubclass(kind, KeyboardInterrupt):
        print(SAYS, file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)
    sys.__excepthook__(kind, error, trace)


sys.excepthook = _hook
