"""Settings of the answers: thresholds with their reasons, intervals, units.

Thresholds were set before any result was looked at, and stand in every answer.
"""

from dataclasses import dataclass

from scipy.stats import norm

# --- Thresholds -----------------------------------------------------------------------


@dataclass(frozen=True)
class Settings:
    """Thresholds that decide what an answer says.

    Attributes:
        significance: p-value below which there is a mismatch, and a residual counts as
            one; the rule of the format.
        confidence: Of all intervals; the rule of the format.
        name_probability: Least probability of a name with its equivalents; the rule of
            the format.
        equivalent_log_bayes: Log Bayes factor within which a name would do as well; the
            rule of the format.
        standard_errors: By which a gain on data left out has to exceed zero; chosen: a
            gain by chance is that large once in forty.
        explained_share: Of what noise does not explain, from which all is explained
            though the residual is significant; the rule of the format.
        explained_share_low: The same for the low end of its interval.
        small_residual: Share of the mismatch that may be left significantly without
            withholding a name; chosen: what `explained_share_low` leaves.
        simulator_ratio: Rms of the simulator's nominal arm over that of the fitted one,
            above which they are not the same arm; the rule of the format.
        resamples: Draws of a bootstrap; chosen: the ends of the interval move by less
            than 2 % of it.
    """

    significance: float = 0.005
    confidence: float = 0.95
    name_probability: float = 0.95
    equivalent_log_bayes: float = 3.0
    standard_errors: float = 2.0
    explained_share: float = 0.98
    explained_share_low: float = 0.95
    small_residual: float = 0.05
    simulator_ratio: float = 1.5
    resamples: int = 1999


SETTINGS = Settings()
"""Of this version."""


# --- Intervals ------------------------------------------------------------------------


@dataclass(frozen=True)
class Interval:
    """An estimate and the interval it lies in; without ends where no data hold it.

    Attributes:
        estimate: Of all rows; in SI where it is a physical quantity.
        low: Lower end.
        high: Upper end.
    """

    estimate: float
    low: float
    high: float

    @property
    def sigma(self) -> float:
        """Standard deviation of a normal distribution with such an interval."""
        width = 2.0 * float(norm.ppf((1.0 + SETTINGS.confidence) / 2.0))
        return (self.high - self.low) / width


# --- Units in which people read -------------------------------------------------------

MM, UM = 1e3, 1e6
"""Number per m."""
MRAD, URAD = 1e3, 1e6
"""Number per rad."""
MICRO = 1e6
"""Number per m or rad, where an axis may slide or turn."""
