"""After a name is given, everything is asked once more whether something is left."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.crossing import beside_many, cross_of
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.detect import Found, detect
from stiffness.diagnosis.evidence import Evidence, evidence_of, projected
from stiffness.diagnosis.library import Library
from stiffness.diagnosis.member import Member, SetFit
from stiffness.diagnosis.refine import shape_columns
from stiffness.diagnosis.scatter import scatter_of
from stiffness.diagnosis.signature import Signature


def what_is_left(case: Case, fit: SetFit) -> Found:
    """Test everything again after a set is named, other forms of its laws allowed.

    Other shapes of what is named are no candidates: a law is searched along a line, and
    what that leaves of a strong one is not news.
    """
    fold = case.evidence.fold
    after = without_set(case, fit)
    known, own = after.known, after.evidence
    count = own.gram.shape[1]
    every = [*known, *case.library.signatures]
    side, score = cross_of(after.data, known, every, fold)
    gram = beside_many(side, case.evidence.gram)
    raw = np.concatenate([own.raw, case.evidence.raw])
    joint = Evidence(gram, score, fold, raw)
    named = {member.name for member in fit.members}
    library = _moved(case.library, count, named)
    mask = ~case.split.held_out
    known = np.arange(count)
    scatter = scatter_of(after.data, case.wild)
    return detect(library, joint, score, known, mask, case.seed + 1, scatter)


@dataclass(frozen=True)
class After:
    """A recording once a set is named.

    Attributes:
        known: Nominal columns, the set's laws, a little more of their shapes, their
            other forms.
        evidence: What the readings say of these.
        data: The readings without what these explain.
    """

    known: list[Signature]
    evidence: Evidence
    data: Data


def without_set(case: Case, fit: SetFit) -> After:
    """Take what a set explains, in any accepted form, out of the readings."""
    members = [m.signature(case.situation) for m in fit.members]
    extra: list[Signature] = []
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        extra.extend(shape_columns(case.situation, member, coefficients))
    known = [*case.nominal, *members, *extra, *other_forms(case, fit.members)]
    own = evidence_of(case.data, known, case.evidence.fold)
    beta = projected(own.gram[1], own.score[~case.split.held_out].sum(axis=0))
    return After(known, own, case.data.less(known, beta))


def other_forms(case: Case, members: Sequence[Member]) -> list[Signature]:
    """Return the other accepted forms of named laws.

    They are not held against a name, nor do they earn one for another effect.
    """
    forms = (m.hypothesis.variants(case.situation, m.where, m.shape) for m in members)
    return [form for form in forms if form.columns]


def _moved(library: Library, by: int, named: set[tuple[str, str]]) -> Library:
    return replace(
        library,
        candidates=tuple(
            replace(c, columns=tuple(block + by for block in c.columns))
            for c in library.candidates
            if c.name not in named
        ),
        map=tuple(replace(m, columns=m.columns + by) for m in library.map),
    )
