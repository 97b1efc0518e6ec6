"""In the terminal the story is told in sentences, and what was named in a table."""

from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from scenarios.diagnosing import story
from scenarios.diagnosing.finding import Finding
from scenarios.diagnosing.units import chance, label, span


def tell(console: Console, finding: Finding, notes: tuple[str, ...], out: Path) -> None:
    """Print the story, the table, and where the report is."""
    for sentence in story.sentences(finding):
        console.print(sentence, markup=False, highlight=False)
    told = finding.answer
    if told.named:
        table = Table(title="Named", title_justify="left")
        columns = ["effect", "where", "probability", "parameters"]
        if any(n.equivalents for n in told.named):
            columns.append("would do as well")
        for column in columns:
            table.add_column(column)
        for n in told.named:
            sizes = [f"{label(k)} {span(k, p)}" for k, p in n.parameters.items()]
            others = ", ".join(f"{e.effect}@{e.where}" for e in n.equivalents[:3])
            cells = (n.effect, n.where, chance(n.probability), "\n".join(sizes), others)
            table.add_row(*map(escape, cells[: len(columns)]))
        console.print(table)
    for note in notes:
        console.print(f"Note: {note}", markup=False, highlight=False)
    console.print(f"{out / 'report.html'}", markup=False, highlight=False)
