"""Tables of all effects in bench/README.md, from the catalogue and the mechanisms.

Run `python tests/effect_table.py` to write them anew; a test compares.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

from bench.effects import EFFECTS
from bench.shared.effect_catalogue import CATALOGUE, EffectInfo, Parameter, si_unit

README = Path(__file__).parents[1] / "bench" / "README.md"
COMMAND = "python tests/effect_table.py"
BEGIN, END = "<!-- effects: begin -->", "<!-- effects: end -->"
EXAMPLE = {"axis": "a6", "link": "link_2", "marker": "marker:x"}
"""Where a mechanism is built to ask for its defaults."""
SEEN = {"within_visit": "differences", "between_visits": "means"}


@dataclass(frozen=True)
class Line:
    """Parameters of one effect that stand in one row.

    Attributes:
        names: Of the parameters.
        role: Magnitude or shape.
        defaults: Of the mechanism; empty where there is none.
        parameter: One of them, for unit and usual range.
    """

    names: tuple[str, ...]
    role: str
    defaults: tuple[str, ...]
    parameter: Parameter

    @property
    def alike(self) -> tuple:
        """What parameters that share a row have in common."""
        return self.role, si_unit(self.names[0]), self.parameter.usual


def number(value: float | str) -> str:
    """Return a number in three digits as 0.03, 1800 or 6.3e5; a name as it is."""
    if isinstance(value, str):
        return f"`{value}`"
    size = abs(value)
    if size == 0.0 or 1e-3 < size < 1e4:
        return f"{float(f'{value:.3g}'):g}"
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def lines_of(info: EffectInfo) -> list[Line]:
    """Return an effect's parameters, those that are alike in one row."""
    kinds = {kind.name: kind for kind in EFFECTS}
    defaults = {}
    if info.name in kinds:
        kind = kinds[info.name]
        where = EXAMPLE.get(kind.places[0], kind.places[0])
        usual = kind(where)
        assumed = {f.name: getattr(usual, f.name) for f in fields(usual)}
        defaults = {**assumed, **usual.parameters()}
    found: list[Line] = []
    for p in info.parameters:
        own = (number(defaults[p.name]),) if p.name in defaults else ()
        line = Line((p.name,), p.role, own, p)
        if found and found[-1].alike == line.alike:
            last = found.pop()
            names, shown = last.names + line.names, last.defaults + line.defaults
            line = Line(names, line.role, shown, p)
        found.append(line)
    return found


def effect_rows() -> Iterator[tuple[str, ...]]:
    """Yield effect, sites, what it depends on, where it shows, what is left out."""
    for info in CATALOGUE.values():
        seen = [text for key, text in SEEN.items() if key in info.visible_in]
        yield (
            f"`{info.name}`",
            ", ".join(f"`{site}`" for site in info.sites),
            ", ".join(info.depends_on) or "nothing: a constant",
            " and ".join(seen),
            info.leaves_out,
        )


def parameter_rows() -> Iterator[tuple[str, ...]]:
    """Yield effect, parameters, unit, role, defaults, usual range with its source."""
    for info in CATALOGUE.values():
        for line in lines_of(info):
            usual = line.parameter.usual
            span = "none known"
            if usual is not None:
                span = f"{number(usual.low)} to {number(usual.high)} ({usual.source})"
            yield (
                f"`{info.name}`",
                ", ".join(f"`{name}`" for name in line.names),
                si_unit(line.names[0]) or "1",
                line.role,
                ", ".join(line.defaults) or "no mechanism",
                span,
            )


def table(heads: tuple[str, ...], rows: Iterator[tuple[str, ...]]) -> str:
    """Return a table in Markdown."""
    every = [heads, tuple("---" for _ in heads), *rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in every)


def tables() -> str:
    """Return both tables as they stand in the file."""
    effects = table(
        ("effect", "where", "depends on", "shows in", "what the nominal model lacks"),
        effect_rows(),
    )
    parameters = table(
        ("effect", "parameters", "unit", "role", "default", "usual range"),
        parameter_rows(),
    )
    return f"{effects}\n\n{parameters}"


def written(text: str) -> str:
    """Return what stands between the marks of a text."""
    found = re.search(f"{BEGIN}\n\n(.*?)\n\n{END}", text, re.DOTALL)
    return found[1] if found else ""


def main() -> None:
    """Write the tables anew."""
    text = README.read_text("utf-8")
    start, rest = text.split(BEGIN)
    _, end = rest.split(END)
    new = f"{start}{BEGIN}\n\n{tables()}\n\n{END}{end}"
    README.write_text(new, "utf-8")


if __name__ == "__main__":
    main()
