"""Springs are fitted silently, and where they are not the model's it is said."""

from collections.abc import Iterator

from stiffness.diagnosis.diagnosis import Nominal

ANOTHER = 0.1
"""Share by which a stiffness is another than the model's; chosen: catalogues are no
better."""
SIGMAS = 3.0
"""Standard errors that it has to be away as well; chosen."""


def rows(nominal: Nominal, slides: tuple[bool, ...]) -> Iterator[list[str]]:
    """Yield axis, stiffness, its standard error, the model's, and their ratio.

    Stiffness is in kN m/rad; of an axis that slides in N/m, which is said.

    Args:
        nominal: What was fitted silently.
        slides: Whether each axis slides; none where empty.
    """
    every = zip(nominal.compliance, nominal.sigma, nominal.modelled, strict=True)
    for k, (c, s, m) in enumerate(every):
        unit, word = (1.0, " N/m") if slides and slides[k] else (1e-3, "")
        stiffness, model = (
            f"{unit / x:.4g}{word}" if x > 0.0 else "rigid" for x in (c, m)
        )
        known = f"{s / c:.1%}" if c > 0.0 and s > 0.0 else ""
        if f"a{k + 1}" in nominal.blind:
            known = "not seen"
        ratio = f"{m / c:.2f}" if c > 0.0 and m > 0.0 and known != "not seen" else ""
        yield [f"a{k + 1}", stiffness, known, model, ratio]


def sentence(nominal: Nominal) -> str:
    """Say which springs are clearly not the model's; empty where all are."""
    told = []
    every = zip(nominal.compliance, nominal.sigma, nominal.modelled, strict=True)
    for k, (c, s, m) in enumerate(every):
        if min(c, s, m) <= 0.0 or f"a{k + 1}" in nominal.blind:
            continue
        if abs(c - m) > max(ANOTHER * c, SIGMAS * s):
            told.append(f"a{k + 1} {m / c:.3g} ± {s * m / c**2:.1g}")
    if not told:
        return ""
    return (
        "Springs were fitted silently. Over the model's stiffness, ± one sigma of "
        f"noise: {', '.join(told)}."
    )
