"""A laboratory's table and its mapping, to be spoilt and imported."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from bench.shared.errors import Unusable
from bench.shared.format import folder as files
from bench.shared.recording import Recording
from scenarios.import_recording import Settings, main

# --- A table and its mapping ----------------------------------------------------------

NAMES: tuple[str, ...] = (
    "t",
    "Nr",
    "J1",
    "J2",
    "Fx",
    "Fy",
    "Fz",
    "Größe X",
    "Größe Y",
    "Größe Z",
    "B",
)
UNITS = ("s", "", "deg", "rad", "N", "N", "N", "mm", "mm", "mm", "")
ROWS = tuple(
    (f"{20 * k}", f"{k + 1}", f"{3 * k},5", f"0,{k}", f"{k}", "0,5", "0", *xyz, "µ")
    for k in range(7)
    for xyz in [(f"{k},25", f"-{k},5", "0,125")]
)


@dataclass(frozen=True)
class Lab:
    """A table as text, and a mapping in parts."""

    names: tuple[str, ...] = NAMES
    rows: tuple[tuple[str, ...], ...] = ROWS
    above: tuple[str, ...] = ()
    encoding: str = "utf-8"
    top: str = ""
    csv: tuple[str, ...] = ('separator = ";"', 'decimal = ","')
    columns: dict[str, str] = field(
        default_factory=lambda: {
            "time_s": '"t"',
            "pose": '"Nr"',
            "a1_deg": '"J1"',
            "a2_deg": '{ from = "J2", unit = "rad" }',
            "fx_n": '"Fx"',
            "fy_n": '"Fy"',
            "fz_n": '"Fz"',
            "p_x_mm": '"Größe X"',
            "p_y_mm": '"Größe Y"',
            "p_z_mm": '"Größe Z"',
        }
    )
    sensors: str = "accuracy_n = 0.5"
    part: str = "csv"
    marker: str = "p"
    below: str = ""
    skip: tuple[int, ...] = ()

    def without(self, name: str, said: str) -> "Lab":
        """Take a column out of the table and the mapping."""
        k = self.names.index(name)
        return replace(
            self,
            names=(*self.names[:k], *self.names[k + 1 :]),
            rows=tuple((*r[:k], *r[k + 1 :]) for r in self.rows),
            columns={n: c for n, c in self.columns.items() if n != said},
        )

    def cell(self, row: int, name: str, text: str) -> "Lab":
        """Put another text into a cell; rows are counted from 1 of those that are."""
        cells, k = list(self.rows[row]), self.names.index(name)
        cells[k] = text
        return replace(
            self, rows=(*self.rows[:row], tuple(cells), *self.rows[row + 1 :])
        )

    def write(self, folder: Path) -> None:
        """Write table and mapping."""
        lines = [*self.above, *(";".join(r) for r in (self.names, *self.rows))]
        text = "\r\n".join(lines) + "\r\n"
        (folder / "lab.csv").write_bytes(text.encode(self.encoding))
        skip = [f"skip_rows = {list(self.skip)}"] if self.skip else []
        said = [
            'format = 1\nrows = "plateaus"',
            self.top,
            f"[{self.part}]",
            *self.csv,
            *skip,
            "[columns]",
            *(f"{name} = {entry}" for name, entry in self.columns.items()),
            "[sensors.tracker]\nrepeatability_mm = 0.02",
            f"[sensors.wrench]\n{self.sensors}",
            f'[markers.{self.marker}]\nbody = "link_2"',
            self.below,
        ]
        (folder / "map.toml").write_text("\n".join(said), encoding="utf-8")


def imported(folder: Path) -> Recording:
    out = folder / "out"
    recording = main(Settings(folder / "lab.csv", folder / "map.toml", out))
    assert recording is not None
    read, _ = files.read(out)  # what was written is a whole recording
    np.testing.assert_array_equal(read.posture, recording.posture)
    return recording


def faults_of(folder: Path) -> tuple[str, ...]:
    with pytest.raises(Unusable) as caught:
        imported(folder)
    assert not (folder / "out").exists()
    assert "samples.csv" not in str(caught.value)
    assert "recording.toml" not in str(caught.value)
    return caught.value.faults


def read_of(folder: Path, lab: Lab) -> Recording:
    lab.write(folder)
    return imported(folder)
