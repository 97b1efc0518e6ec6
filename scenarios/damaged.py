"""Diagnoses damaged recordings and counts what becomes of them.

Damages a good recording of a KR10 with hysteresis in many ways and hands each to
`scenarios.diagnose`. What the files themselves show must be refused with its place
named; what only the physics shows must be said, and no effect named while it stands.
Columns exchanged, rows that slipped, markers' names and units of force count as
recognised only where they are said by their own name.

Run:    python -m scenarios.damaged --variants 200 --seed 0
Takes:  1 minute on one core
Expect: what became of each kind, counted; none that crashes, none diagnosed without
        a warning, none half written; exit status 1 otherwise
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from scenarios.report.command_line import at_least, progress_bar, run

if TYPE_CHECKING:
    from scenarios.studies.damage import Damage, DamageOutcome

OTHER = Path(__file__).parents[1] / "mjcf" / "ur10" / "ur10.xml"


@dataclass(frozen=True)
class Settings:
    """How many, and which."""

    variants: int = 200
    """How many damages, drawn from all."""
    seed: int = 0
    """Of the damages."""
    poses: int = 20
    """Postures of the good recording."""


def main(settings: Settings) -> Sequence[DamageOutcome]:
    """Damage, diagnose, count."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from scenarios.studies.damage import WHAT, damages, good_recording, own_names

    at_least(0, seed=settings.seed)
    at_least(1, variants=settings.variants, poses=settings.poses)
    with TemporaryDirectory(prefix="damaged-") as folder:
        good = good_recording(Path(folder) / "good", settings.poses)
        chosen = damages(good, settings.variants, settings.seed)
        with progress_bar() as progress:
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


def outcome_of(damage: Damage, folder: Path) -> DamageOutcome:
    """Write a damaged recording and diagnose it."""
    from rich.console import Console

    from bench.shared.errors import BenchError
    from scenarios.pipelines import synthetic_recording
    from scenarios.report.route import diagnose_to_folder
    from scenarios.studies.damage import MISTAKES, DamageOutcome

    recording, out = folder / "recording", folder / "answer"
    recording.mkdir(parents=True)
    damage.write(recording)
    robot = OTHER if damage.other_model else synthetic_recording.KR10
    try:
        told = diagnose_to_folder(recording, robot, out, Console(quiet=True))
    except BenchError as error:
        whole = not out.exists()
        return DamageOutcome(damage, "refused" if whole else "half written", str(error))
    except Exception as error:
        return DamageOutcome(damage, "crashed", f"{type(error).__name__}: {error}")
    mistakes = [w for w in told.warnings if w.code in MISTAKES]
    if mistakes and not told.named:
        what = "warned" if damage.recognised(mistakes) else "misnamed"
        return DamageOutcome(damage, what, ", ".join(w.code for w in mistakes))
    names = ", ".join(map(str, told.named))
    return DamageOutcome(damage, "diagnosed", f"{told.verdict}: {names}")


if __name__ == "__main__":
    run(main, Settings)
