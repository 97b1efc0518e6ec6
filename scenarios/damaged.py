"""What becomes of a recording that was damaged on its way?

Damages a good recording of a KR10 with hysteresis in many ways and hands each to
`scenarios.diagnose`. What the files themselves show must be refused with its place
named; what only the physics shows must be said, and no effect named while it stands.
Columns exchanged, rows that slipped, markers' names and units of force count as
recognised only where they are said by their own name.

Run:    python -m scenarios.damaged --variants 200 --seed 0
Takes:  1 minute on one core
Expect: what became of each kind, counted; none that crashes, none diagnosed silently,
        none half written; exit status 1 otherwise
"""

import io
from collections import Counter
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bench.errors import BenchError
from scenarios import diagnose, record
from scenarios.command import run
from scenarios.damaging.damage import Damage
from scenarios.damaging.in_files import in_files
from scenarios.damaging.in_meaning import in_meaning
from scenarios.damaging.in_set_up import in_set_up
from scenarios.damaging.samples import Samples
from scenarios.reporting.bar import bar
from scenarios.watching import Watching

OTHER = Path(__file__).parents[1] / "mjcf" / "ur10" / "ur10.xml"
MISTAKES = (
    *("axis_reversed", "axis_order", "axis_zero", "mirrored", "units", "wrong_model"),
    *("wrench_sign", "wrench_frame", "wrench_columns", "wrench_rows"),
    *("tracker_frame", "marker_places", "marker_names"),
)
"""Codes of warnings while which no effect is named."""
WHAT = ("refused", "warned", "misnamed", "diagnosed", "half written", "crashed")
"""What can become of one."""
RIGHT = {"file": ("refused",), "physics": ("warned", "refused")}
"""What has to become of each; an angle of the wrong sign may exceed its limits too."""


@dataclass(frozen=True)
class Settings:
    """How many, and which."""

    variants: int = 200
    """How many damages, drawn from all."""
    seed: int = 0
    """Of the damages."""
    poses: int = 20
    """Postures of the good recording."""


@dataclass(frozen=True)
class Outcome:
    """What became of one."""

    damage: Damage
    what: str
    said: str

    @property
    def right(self) -> bool:
        """Whether it had to be so."""
        return self.what in RIGHT[self.damage.shows]


def main(settings: Settings) -> Sequence[Outcome]:
    """Damage, diagnose, count."""
    with TemporaryDirectory(prefix="damaged-") as folder:
        good = good_recording(Path(folder) / "good", settings.poses)
        chosen = damages(good, settings.variants, settings.seed)
        with bar() as progress:
            outcomes = [
                outcome_of(damage, Path(folder) / str(number))
                for number, damage in enumerate(
                    progress.track(chosen, description="diagnosing")
                )
            ]
    console = Console()
    table = Table("shows in the", *WHAT)
    for shows in ("file", "physics"):
        counts = Counter(o.what for o in outcomes if o.damage.shows == shows)
        table.add_row(shows, *(str(counts[name]) for name in WHAT))
    wrong = [o for o in outcomes if not o.right]
    for outcome in wrong:
        console.print(escape(f"{outcome.damage.name}: {outcome.what}. {outcome.said}"))
    console.print(table)
    console.print(*own_names(outcomes), sep="\n")
    console.print(f"{len(outcomes) - len(wrong)} of {len(outcomes)} as they should.")
    if wrong:
        raise SystemExit(1)
    return outcomes


def own_names(outcomes: Sequence[Outcome]) -> list[str]:
    """Count the mistakes that have to be said by their own name."""
    planted = Counter(o.damage.code for o in outcomes if o.damage.code)
    said = Counter(o.damage.code for o in outcomes if o.what == "warned")
    return [f"{code}: {said[code]} of {n} said." for code, n in sorted(planted.items())]


def good_recording(folder: Path, poses: int) -> Samples:
    """Record a KR10 with hysteresis, watched at the flange."""
    effect = ("hysteresis@a2,width_rad=3e-4",)
    watch = Watching(targets="flange", state_frame=True)
    with redirect_stdout(io.StringIO()):
        record.main(
            record.Settings(
                out=folder, effect=effect, poses=poses, path="0,10,0", watch=watch
            )
        )
    return Samples.of(folder)


def damages(good: Samples, variants: int, seed: int) -> list[Damage]:
    """Draw damages of both kinds, in proportion to how many there are."""
    random = np.random.default_rng(seed)
    every = [*in_files(good, random), *in_meaning(good, random), *in_set_up(good)]
    order = random.permutation(len(every))[:variants]
    return [every[k] for k in sorted(order)]


def outcome_of(damage: Damage, folder: Path) -> Outcome:
    """Write a damaged recording and diagnose it."""
    recording, out = folder / "recording", folder / "answer"
    recording.mkdir(parents=True)
    damage.make(recording)
    robot = OTHER if damage.other_model else record.KR10
    try:
        with redirect_stdout(io.StringIO()):
            told = diagnose.main(diagnose.Settings(recording, robot, out))
    except BenchError as error:
        whole = not out.exists()
        return Outcome(damage, "refused" if whole else "half written", str(error))
    except Exception as error:
        return Outcome(damage, "crashed", f"{type(error).__name__}: {error}")
    mistakes = [w for w in told.warnings if w.code in MISTAKES]
    if mistakes and not told.named:
        what = "warned" if damage.recognised(mistakes) else "misnamed"
        return Outcome(damage, what, ", ".join(w.code for w in mistakes))
    names = ", ".join(f"{n.effect} at {n.where}" for n in told.named)
    return Outcome(damage, "diagnosed", f"{told.verdict}: {names}")


if __name__ == "__main__":
    run(main, Settings)
