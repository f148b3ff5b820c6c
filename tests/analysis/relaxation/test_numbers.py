"""Values and errors as they are written."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.relaxation.numbers import concise


@pytest.mark.parametrize(
    ("value", "error", "written"),
    [(2.278, 0.038, "2.28(4)"), (79.92, 0.0073, "79.920(7)"), (1527.7, 12.0, "1528(12)"), (0.3, None, "0.3")],
)
def test_a_value_is_written_to_the_digit_of_its_error(
    value: float, error: float | None, written: str
) -> None:
    assert concise(value, error) == written


@given(st.floats(0.01, 900.0), st.floats(1e-4, 0.5))
def test_no_written_value_is_off_by_more_than_half_its_error(value: float, share: float) -> None:
    text = concise(value, share * value)
    assert abs(float(text.split("(")[0]) - value) <= 0.5 * share * value + 1e-9
    assert len(text) <= 12
