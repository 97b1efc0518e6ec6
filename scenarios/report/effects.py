"""Tables of effects for the terminal: those that can be asked for, and their sizes."""

from collections.abc import Iterator, Sequence
from dataclasses import fields

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from bench.effect_size import VISITS, EffectSize
from bench.effects import EFFECTS
from bench.effects.effect import Effect
from bench.instruments import Instruments
from bench.kinematic_chain import Anatomy
from bench.shared.effect_catalogue import CATALOGUE, si_unit
from scenarios.pipelines.synthetic_recording import rms_noise

# --- Effects that can be asked for ----------------------------------------------------

USE = (
    "--effect NAME@WHERE,parameter=value,… in SI units. Parameters left out keep their "
    "default; of shifts, turns and the like, those left out beside others are zero."
)


def catalogue_tables(arm: Anatomy) -> Group:
    """Return all effects with places on an arm, parameters, units, defaults, ranges."""
    parts = [Text(USE)]
    for kind in EFFECTS:
        known = CATALOGUE[kind.name]
        where = ", ".join(_places(place, arm) for place in kind.places)
        heading = Text(f"\n{kind.name}", "bold").append(f" @ {where}", "not bold")
        table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0))
        for column in ("    parameter", "default", "unit", "usual range"):
            table.add_column(column, header_style="dim", overflow="fold")
        for row in _parameters(kind):
            table.add_row(*map(escape, row))
        parts += [heading, Text(f"    {known.leaves_out}", "italic"), table]
    return Group(*parts)


def _parameters(kind: type[Effect]) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, default, unit and usual range of each of an effect's parameters."""
    for field in fields(kind):
        if field.name == "where":
            continue
        name = field.name.removesuffix("_axis")
        default, usual = field.default, CATALOGUE[kind.name].usual(name)
        text = default if isinstance(default, str) else f"{default:.4g}"
        span = f"{usual.low:.3g} to {usual.high:.3g} ({usual.source})" if usual else ""
        yield f"    {name}", text, si_unit(name), span


def _places(kind: str, arm: Anatomy) -> str:
    """Return the places of a kind, such as `a1 to a6`."""
    prefix = {"axis": "a", "link": "link_"}.get(kind)
    if prefix:
        return f"{prefix}1 to {prefix}{len(arm.axes)}"
    return "marker:NAME, such as marker:link1_a" if kind == "marker" else kind


# --- What effects move ----------------------------------------------------------------


def sizes_table(sizes: Sequence[EffectSize], instruments: Instruments) -> Table:
    """Return what each effect moves, beside the noise of what sees it."""
    title = (
        f"What each effect moves, rms over {sizes[0].visits} visits, without noise "
        f"(evenly taken: {VISITS} in all are simulated, shared by the effects)"
    )
    table = Table(title=title, title_justify="left", title_style="not italic")
    table.add_column("effect", overflow="fold")
    for heading in ("marks [µm]", "force [N]", "torque [N m]"):
        table.add_column(heading, justify="right")
    for size in sizes:
        numbers = (size.points * 1e6, size.force, size.torque)
        known = size.points == size.points  # else the others alone find no rest
        cells = [_digits(x) for x in numbers] if known else ["?"] * 3
        table.add_row(escape(f"{size.effect.name}@{size.effect.where}"), *cells)
    table.add_section()
    sensor = instruments.force_sensor
    noise = (rms_noise(instruments) * 1e6, sensor.accuracy_force)
    cells = [_digits(x) for x in (*noise, sensor.accuracy_torque)]
    table.add_row("noise of a reading, one sigma", *cells, style="dim")
    return table


def _digits(value: float) -> str:
    """Return at least two digits, and none of what is below a millionth."""
    if value < 1e-6:
        return "0"
    return f"{value:.0f}" if value >= 10.0 else f"{value:.2g}"
