"""After a name is given, everything is asked once more whether something is left."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.detect import Found, detect
from stiffness.diagnosis.evidence import (
    Evidence,
    cross_of,
    evidence_of,
    projected,
    scores_of,
)
from stiffness.diagnosis.library import Library
from stiffness.diagnosis.member import Member, SetFit
from stiffness.diagnosis.refine import shape_columns
from stiffness.diagnosis.signature import Signature


def what_is_left(case: Case, fit: SetFit) -> Found:
    """Test everything again after a set is named, other forms of its laws allowed."""
    own = [m.signature(case.situation) for m in fit.members]
    extra: list[Signature] = []
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        extra.extend(shape_columns(case.situation, member, coefficients))
    known = [*case.nominal, *own, *extra, *other_forms(case, fit.members)]
    fold = case.evidence.fold
    own_gram = evidence_of(case.data, known, fold)
    count = own_gram.gram.shape[1]
    side = cross_of(case.data, known, case.library.signatures, fold)
    gram = np.block([[own_gram.gram, side], [side.swapaxes(1, 2), case.evidence.gram]])
    mask = ~case.split.held_out
    score = own_gram.score[mask].sum(axis=0)
    beta = projected(own_gram.gram[1], score)
    data = case.data.less(known, beta)
    score = scores_of(data, [*known, *case.library.signatures])
    raw = np.concatenate([own_gram.raw, case.evidence.raw])
    joint = Evidence(gram, score, fold, raw)
    library = _moved(case.library, count)
    return detect(library, joint, score, np.arange(count), mask, case.seed + 1)


def other_forms(case: Case, members: Sequence[Member]) -> list[Signature]:
    """Return the other accepted forms of named laws.

    They are not held against a name, nor do they earn one for another effect.
    """
    forms = (m.hypothesis.variants(case.situation, m.where, m.shape) for m in members)
    return [form for form in forms if form.columns]


def _moved(library: Library, by: int) -> Library:
    return replace(
        library,
        candidates=tuple(
            replace(c, columns=tuple(block + by for block in c.columns))
            for c in library.candidates
        ),
        map=tuple(replace(m, columns=m.columns + by) for m in library.map),
    )
