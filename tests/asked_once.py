"""A function that works out an answer once, for time, however often it is asked."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar

import joblib

Found = TypeVar("Found")


def once(step: Callable[..., Found]) -> Callable[..., Found]:
    """Return a function of records that keeps answers by what the records hold."""
    known: dict[tuple[str | None, ...], Found] = {}

    def known_or_found(*records: Any) -> Found:
        # Field by field: the hash of a whole depends on which objects its fields share.
        parts = (getattr(r, f.name) for r in records for f in fields(r))
        asked = tuple(joblib.hash(part) for part in parts)
        if asked not in known:
            known[asked] = step(*records)
        return known[asked]

    return known_or_found
