"""A recording's two files as text, and a folder written anew from them."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

from bench.format.manifest import FILE
from bench.format.samples import CSV_FILE


@dataclass(frozen=True)
class Samples:
    """What stands in the files of a recording.

    Attributes:
        manifest: Text of recording.toml.
        header: Names of the columns.
        rows: Cells below them.
    """

    manifest: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, folder: Path) -> "Samples":
        """Read them as text."""
        with (folder / CSV_FILE).open(newline="", encoding="utf-8") as file:
            header, *rows = (tuple(row) for row in csv.reader(file))
        text = (folder / FILE).read_text(encoding="utf-8")
        return cls(text, header, tuple(rows))

    def write(self, folder: Path) -> None:
        """Write them into a folder that is there."""
        (folder / FILE).write_text(self.manifest, encoding="utf-8")
        with (folder / CSV_FILE).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([self.header, *self.rows])

    def column(self, name: str) -> list[str]:
        """Return a column's cells."""
        k = self.header.index(name)
        return [row[k] for row in self.rows]

    def having(self, **columns: list[str]) -> "Samples":
        """Return the same with other cells in some columns."""
        at = {self.header.index(name): cells for name, cells in columns.items()}
        rows = [
            tuple(at[k][r] if k in at else cell for k, cell in enumerate(row))
            for r, row in enumerate(self.rows)
        ]
        return replace(self, rows=tuple(rows))

    def scaled(self, factor: float, *names: str) -> "Samples":
        """Return the same with numbers in some columns times a factor."""
        return self.having(
            **{
                name: [repr(float(c) * factor) if c else "" for c in self.column(name)]
                for name in names
            }
        )

    def cell(self, row: int, name: str, text: str) -> "Samples":
        """Return the same with another text in one cell."""
        cells = self.column(name)
        cells[row] = text
        return self.having(**{name: cells})

    def without(self, *names: str) -> "Samples":
        """Return the same without some columns."""
        keep = [k for k, name in enumerate(self.header) if name not in names]
        return replace(
            self,
            header=tuple(self.header[k] for k in keep),
            rows=tuple(tuple(row[k] for k in keep) for row in self.rows),
        )
