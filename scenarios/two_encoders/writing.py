"""An answer is written whole: made beside its folder and moved there file by file."""

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import mkdtemp

from bench.patch import Patch
from scenarios.diagnosing import answer as form
from scenarios.diagnosing.schema import Answer
from scenarios.reporting import page
from scenarios.reporting.page import Block, Paragraph
from scenarios.two_encoders.axis import Axis
from scenarios.two_encoders.patching import write_patch
from scenarios.two_encoders.playback import PLAYBACK, save
from scenarios.two_encoders.report import blocks_of, first_sentence


def written(
    folder: Path, axes: Sequence[Axis], answer: Answer, patch: Patch | None = None
) -> None:
    """Write diagnosis.json, pictures, the report, a playback and the patch, if any."""

    def blocks(waiting: Path) -> list[Block]:
        if patch is not None:
            write_patch(waiting, patch)
        save(axes, waiting / PLAYBACK)
        return blocks_of(axes, answer, waiting)

    _whole(folder, answer, first_sentence(axes, answer), blocks)


def refused(folder: Path, answer: Answer) -> None:
    """Write diagnosis.json and a report that says what has to be mended."""
    mistakes = [Paragraph(w.text) for w in answer.warnings]
    _whole(folder, answer, "Nothing is named: the set-up is wrong.", lambda _: mistakes)


def _whole(
    folder: Path,
    answer: Answer,
    first: str,
    blocks: Callable[[Path], Sequence[Block]],
) -> None:
    folder.parent.mkdir(parents=True, exist_ok=True)
    waiting = Path(mkdtemp(prefix=".two-encoders-", dir=folder.parent))
    try:
        title = f"Two encoders an axis: {answer.recording}"
        page.write(waiting, title, first, blocks(waiting))
        text = form.text_of(answer)
        (waiting / "diagnosis.json").write_text(text, encoding="utf-8")
        folder.mkdir(exist_ok=True)
        for file in sorted(waiting.iterdir()):
            os.replace(file, folder / file.name)
    finally:
        shutil.rmtree(waiting, ignore_errors=True)
