"""MuJoCo is compiled; its members are known at run time only."""

from typing import Any

def __getattr__(name: str) -> Any: ...
