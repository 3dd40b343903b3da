"""Long streams are written with bounded memory. NumPy and printf give the reference texts."""

from __future__ import annotations

import io
import tracemalloc
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ssm_planner.formats.agreement import ExportContent
from ssm_planner.formats.csv import table_text

WHOLE = st.integers(-(2**55), 2**55).map(float)


@pytest.mark.parametrize("forms", [("%.3f", "%d"), ("%.9g", "%d"), ("%.3f", "%.17g")])
@pytest.mark.parametrize("count", [0, 1, 70_000])
def test_a_table_in_parts_has_the_text_of_numpy(count: int, forms: tuple[str, str]) -> None:
    rng = np.random.default_rng(1)
    columns = {"time_s": np.arange(count) / 1000, "a": rng.integers(-(2**31), 2**31, count) + 0.0}
    columns["b"] = np.round(1e3 * rng.normal(size=count)) if forms[1] == "%d" else rng.random(count)
    text = io.StringIO()
    rows = np.column_stack(list(columns.values()))
    fmt = [forms[0], forms[1], forms[1]]
    np.savetxt(text, rows, fmt, delimiter=",", header="time_s,a,b", comments="")
    assert "".join(table_text(columns, forms)) == text.getvalue()


def test_writing_a_table_takes_a_bounded_memory(tmp_path: Path) -> None:
    """The memory does not grow with the length of the motion, because the table is written in
    parts.
    """
    peaks = []
    for count in (70_000, 210_000):
        columns = {name: np.arange(float(count)) for name in ("time_s", "a", "b")}
        tracemalloc.start()
        ExportContent({}, {"a.csv": table_text(columns)}).write(tmp_path)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
    assert len((tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()) == 210_001


@given(
    st.lists(st.one_of(WHOLE, st.floats(-1e4, 1e4), st.just(-0.0)), min_size=1, max_size=30),
    st.sampled_from(("%d", "%.3f", "%.12g")),
    st.integers(1, 7),
)
def test_the_text_of_a_number_is_that_of_printf(values: list[float], form: str, block: int) -> None:
    """The numbers are whole numbers, fractions and negative zeros in blocks of any length."""
    column = np.array(values, dtype=float)
    expected = "a,b\n" + "".join(f"{form % value},{form % value}\n" for value in column)
    with patch("ssm_planner.formats.csv.PIECES_PER_BLOCK", block):
        assert "".join(table_text({"a": column, "b": column}, (form, form))) == expected
