"""One file per question; `python -m scenarios.NAME --help` is its manual.

Who interrupts a command while its libraries are still being imported is answered as
later on; where these packages are imported by somebody else's program, nothing changes.
"""

import os
import sys
from types import TracebackType

INTERRUPTED = 130
SAYS = "interrupted; run the same command again, what was finished is kept"


_usual = sys.excepthook


def _hook(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    spec = getattr(sys.modules.get("__main__"), "__spec__", None)
    is_command = spec is not None and spec.name.startswith(f"{__name__}.")
    if is_command and issubclass(kind, KeyboardInterrupt):
        print(SAYS, file=sys.stderr, flush=True)
        os._exit(INTERRUPTED)
    _usual(kind, error, trace)


sys.excepthook = _hook
