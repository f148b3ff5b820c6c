"""Numbers as a person reads them."""

from __future__ import annotations

import pytest

from analysis.mismatch.report import amounts
from analysis.mismatch.report.contents import Comparison


def _compared(before_mn: float, after_mn: float) -> Comparison:
    return Comparison("by the others", 20, 0.3, before_mn, after_mn, 1.1, 1.0, 1e-4)


@pytest.mark.parametrize(
    ("before_mn", "after_mn", "told"),
    [
        (4.0, 0.30014, ["4 mN", "0.3 mN", "0.3 mN"]),
        (0.30021, 0.30014, ["0.3002 mN", "0.3001 mN", "0.3 mN"]),
        (0.3, 0.3, ["0.3 mN", "0.3 mN", "0.3 mN"]),
    ],
)
def test_an_error_that_falls_does_not_read_as_if_it_stayed(
    before_mn: float, after_mn: float, told: list[str]
) -> None:
    """What the fitted tissue has taken up changes the error of skin by a part in a thousand."""
    assert amounts.errors(_compared(before_mn, after_mn)) == told
