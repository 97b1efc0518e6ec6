"""In the terminal the story is told in sentences, and what was named in a table."""

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scenarios.diagnosing import story
from scenarios.diagnosing.finding import Finding
from scenarios.diagnosing.units import label, span


def tell(console: Console, finding: Finding, notes: tuple[str, ...], out: Path) -> None:
    """Print the story, the table, and where the report is."""
    for sentence in story.sentences(finding):
        console.print(sentence, markup=False, highlight=False)
    told = finding.answer
    if told.named:
        table = Table(title="Named", title_justify="left")
        for column in ("effect", "where", "probability", "parameters", "or"):
            table.add_column(column)
        for n in told.named:
            sizes = [f"{label(k)} {span(k, p)}" for k, p in n.parameters.items()]
            others = ", ".join(f"{e.effect}@{e.where}" for e in n.equivalents[:3])
            sure, what = f"{n.probability:.3f}", "\n".join(sizes)
            table.add_row(*map(escape, (n.effect, n.where, sure, what, others)))
        console.print(table)
    for note in notes:
        console.print(f"Note: {note}", markup=False, highlight=False)
    console.print(f"{out / 'report.html'}", markup=False, highlight=False)
