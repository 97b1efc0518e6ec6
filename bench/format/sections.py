"""A section is read field by field, so that every fault in it comes to light."""

import math
from collections.abc import Mapping
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Struct

from bench.format.faults import nearest, quoted


def fill(kind: Any, value: Any, where: str) -> tuple[Any, list[str]]:
    """Build a value of a declared type, going on after the first fault.

    Args:
        kind: A type that msgspec knows; structs and mappings are entered.
        value: What the file says.
        where: Its place in the file, for the faults.

    Returns:
        The value, None where it cannot be built, and the faults. A key that nothing
        knows is a fault and is left out, so that the rest can still be checked.
    """
    choices = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
    section = next((c for c in choices if _is_section(c)), None)
    if isinstance(value, Mapping) and section:
        return _fill_section(section, value, where)
    if isinstance(value, Mapping) and get_origin(kind) is dict:
        item = get_args(kind)[1]
        filled = {k: fill(item, v, _join(where, k)) for k, v in value.items()}
        faults = [fault for _, found in filled.values() for fault in found]
        if any(v is None and found for v, found in filled.values()):
            return None, faults
        return {k: v for k, (v, _) in filled.items()}, faults
    numbers = value if isinstance(value, list) else [value]
    if any(isinstance(n, float) and not math.isfinite(n) for n in numbers):
        return None, [f"{where}: {quoted(value)} is not a finite number."]
    try:
        built = msgspec.convert(value, kind)
    except (msgspec.ValidationError, OverflowError, RecursionError) as error:
        return None, [f"{where}: {quoted(value)} — {first_line(error)}."]
    return built, []


def _fill_section(
    kind: type[Struct], table: Mapping[str, Any], where: str
) -> tuple[Struct | None, list[str]]:
    fields = {f.encode_name: f for f in msgspec.structs.fields(kind)}
    types = get_type_hints(kind, include_extras=True)
    faults = [
        f"{_join(where, key)}: nothing is called so.{nearest(key, list(fields))} "
        f"Known here: {', '.join(fields)}."
        for key in table
        if key not in fields
    ]
    values, whole = {}, True
    for key, known in fields.items():
        if key in table:
            filled, found = fill(types[known.name], table[key], _join(where, key))
            values[known.name] = filled
            faults += found
            whole = whole and not (filled is None and found)
        elif known.required:
            faults.append(f"{_join(where, key)}: missing.")
            whole = False
    return (kind(**values) if whole else None), faults


def first_line(error: Exception) -> str:
    """Return what an error says, on one short line."""
    return quoted(str(error).split("\n")[0])[1:-1] or type(error).__name__


def _is_section(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Struct)


def _join(where: str, key: str) -> str:
    plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    shown = key if plain and len(key) <= 60 else quoted(key)
    return f"{where}.{shown}" if where else shown
