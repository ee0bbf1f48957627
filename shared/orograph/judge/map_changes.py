"""How long a map takes to find what has appeared, and to be rid of what has gone."""

from __future__ import annotations

from orograph.arrays import F64, Mask


def time_to_find_s(stamps_s: F64, shown: Mask, since_s: float) -> float | None:
    """Seconds from `since_s` to the first of ascending stamps (n,) from then on at which it is shown; None if never."""
    found = stamps_s[(stamps_s >= since_s) & shown]
    return float(found[0] - since_s) if len(found) else None


def time_to_clear_s(stamps_s: F64, shown: Mask, since_s: float) -> float | None:
    """Seconds from `since_s` to the first stamp from which on it is not shown to the end; None if it is at the end."""
    after = stamps_s >= since_s
    later, left = stamps_s[after], shown[after]
    if not len(later) or left[-1]:
        return None
    return float(later[int(left.nonzero()[0].max(initial=-1)) + 1] - since_s)
