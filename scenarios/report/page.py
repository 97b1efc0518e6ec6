"""A report as headings, paragraphs, tables, figures and folds, in Markdown and HTML.

`report.md` is for the repository, `report.html` is one file to hand over: its pictures
are inside it.
"""

import base64
import html
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from jinja2 import Environment, FileSystemLoader, select_autoescape

TEMPLATES = Path(__file__).parent
NUMBER = re.compile(r"[<>≤≥+−-]? ?\d|–$")
"""Beginning of a cell that holds a number, or the dash that stands for none."""


@dataclass(frozen=True)
class Heading:
    """The title of a section."""

    text: str
    kind: str = "heading"


@dataclass(frozen=True)
class Paragraph:
    """Running text, without markup."""

    text: str
    kind: str = "paragraph"


@dataclass(frozen=True)
class Table:
    """Rows of cells that are already text, with a caption that states the finding."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    kind: str = "table"


@dataclass(frozen=True)
class Figure:
    """A picture in the report's folder, with a caption that states the finding."""

    caption: str
    file: str
    kind: str = "figure"


@dataclass(frozen=True)
class Points:
    """Sentences, one below the other."""

    texts: Sequence[str]
    kind: str = "points"


@dataclass(frozen=True)
class Fold:
    """Blocks that are shown on demand, below a line that says what they are."""

    text: str
    blocks: Sequence["Block"]
    kind: str = "fold"


Block = Heading | Paragraph | Table | Figure | Points | Fold
Item = TypeVar("Item")


def table_of(
    caption: str, items: Iterable[Item], columns: Mapping[str, Callable[[Item], str]]
) -> Table:
    """Return a table with a row an item; of each column its heading and its cell."""
    rows = [[cell(item) for cell in columns.values()] for item in items]
    return Table(caption, list(columns), rows)


def write(folder: Path, title: str, summary: str, blocks: Sequence[Block]) -> None:
    """Write report.md and report.html.

    Figures are in the folder already; the summary says in one or two sentences what was
    found.
    """
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=select_autoescape(["html.j2"]),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["plain"] = _plain
    environment.globals["side"] = _side
    environment.globals["picture"] = lambda file: _embedded(folder / file)
    for name in ("report.md", "report.html"):
        page = environment.get_template(f"{name}.j2")
        text = page.render(title=title, summary=summary, blocks=blocks)
        (folder / name).write_text(text, encoding="utf-8")


def _plain(text: str) -> str:
    """Return Markdown that shows a text literally, on one line."""
    line = html.escape(" ".join(text.split()), quote=False)
    return re.sub(r"([\\`*\[\]|])", r"\\\1", line)


def _side(table: Table, column: int) -> str:
    """Return the alignment of a column: numbers to the right, words to the left."""
    cells = [row[column] for row in table.rows if row[column].strip()]
    return "right" if cells and all(map(NUMBER.match, cells)) else "left"


def _embedded(picture: Path) -> str:
    data = base64.b64encode(picture.read_bytes()).decode("ascii")
    return f"data:image/png;base64,{data}"
