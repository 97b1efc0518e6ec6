"""A parquet file is small for what it holds, so it is measured before it unfolds."""

from collections.abc import Collection

import pyarrow as pa
import pyarrow.parquet as pa_parquet

from bench.format.faults import quoted

PARQUET_FILE = "samples.parquet"
MAX_CELLS = 150_000_000
"""Most cells of a table (chosen: 1.2 GB)."""
MAX_SIZE = 8 * MAX_CELLS
"""Most bytes of one, unpacked (chosen: its cells as numbers)."""


def measured(source: bytes) -> tuple[tuple[str, ...], str]:
    """Return the names of the columns, and what is too large; empty where nothing.

    Raises:
        ArrowException, OSError, ValueError, OverflowError: Where it is no parquet file.
    """
    about = pa_parquet.ParquetFile(pa.BufferReader(source))
    parts = [about.metadata.row_group(g) for g in range(about.num_row_groups)]
    cells = sum(
        part.column(c).num_values for part in parts for c in range(part.num_columns)
    )
    size = sum(part.total_byte_size for part in parts)
    names = tuple(about.schema_arrow.names)
    if cells > MAX_CELLS:
        return names, f"{PARQUET_FILE} holds {cells} cells; the most is {MAX_CELLS}."
    if size > MAX_SIZE:
        return names, f"{PARQUET_FILE} unfolds to {size} B; the most is {MAX_SIZE}."
    return names, ""


def unfolded(source: bytes, wanted: Collection[str]) -> pa.Table:
    """Read some columns.

    Raises:
        ValueError: Where few long words stand in many rows.
    """
    buffer = pa.BufferReader(source)
    schema = pa_parquet.ParquetFile(buffer).schema_arrow
    words = [field.name for field in schema if _is_text(field.type)]
    file = pa_parquet.ParquetFile(buffer, read_dictionary=words)
    table = file.read(columns=list(wanted), use_threads=False)
    for name in set(words) & set(wanted):
        longest = sum(part.dictionary.nbytes for part in table.column(name).chunks)
        if longest * table.num_rows > MAX_SIZE:
            raise ValueError(f"column {quoted(name)} unfolds to over {MAX_SIZE} B")
    return table


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)
