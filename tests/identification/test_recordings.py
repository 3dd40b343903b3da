"""The reader accepts usable recordings, reports every repair and refuses all other files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ssm_planner.errors import RecordingError
from ssm_planner.identification.recordings import (
    MAX_BYTES,
    find_spikes,
    read_recording,
    read_recordings,
)
from ssm_planner.identification.torque_map import compute_torque_map, recording_kind, rest_mask
from tests.support.recordings import RECORDINGS

NOMINAL = 9.84e-3
RPM = math.pi / 30
SWAPPED = str.maketrans(",.", ".,")

HEADER = '''Date:;2020-07-08 21:17:01
Max. samples:;500
Recorded samples:;{count}
Sampling period:;10.000
"Trigger:;1;0.000000;""Parameter values"";""Channel 1"";""Rising above value"""
;Velocity actual value averaged;Torque actual value averaged
ms;rpm;%
'''


def samples(count: int = 20) -> list[str]:
    return [f"{10 * k}.000;{50 + k % 3};{20 + 0.1 * (k % 7):.1f}" for k in range(count)]


def write(path: Path, lines: list[str], header: str | None = None) -> Path:
    text = (HEADER.format(count=len(lines)) if header is None else header) + "\n".join(lines) + "\n"
    path.write_text(text, encoding="utf-8")
    return path


def read(path: Path, **options):
    return read_recording(path, nominal_torque=NOMINAL, **options)


def test_a_recorder_export_in_si(tmp_path):
    r = read(write(tmp_path / "a.csv", samples()), direction=-1)
    assert r.repairs == ()
    assert r.time[1] == pytest.approx(0.01)
    assert r.w[0] == pytest.approx(-50 * RPM)
    assert r.tau[1] == pytest.approx(-0.201 * NOMINAL)
    assert r.quantum == pytest.approx(RPM, rel=1e-4)


@pytest.mark.parametrize(
    "header",
    [
        "time [ms],velocity [rpm],torque [%]\n",
        "time_ms,speed_rpm,torque_percent\n",
        "Torque (%),t (ms),Velocity (rpm)\n",
        "torque,time,w\n%,ms,rpm\n",
    ],
)
def test_named_columns_in_any_order(tmp_path, header):
    plain = read(write(tmp_path / "a.csv", samples()))
    order = [["time", "velocity", "torque"], ["torque", "time", "velocity"]][
        header.lower().startswith("torque")
    ]
    rows = [
        dict(zip(("time", "velocity", "torque"), line.split(";"), strict=True))
        for line in samples()
    ]
    r = read(
        write(tmp_path / "b.csv", [",".join(row[name] for name in order) for row in rows], header)
    )
    np.testing.assert_allclose(r.w, plain.w)
    np.testing.assert_allclose(r.tau, plain.tau)
    np.testing.assert_allclose(r.time, plain.time)


def test_si_columns_need_no_nominal_torque(tmp_path):
    lines = [f"{k},{1.5 + k % 2},{0.001 * (k % 5)}" for k in range(20)]
    r = read_recording(write(tmp_path / "a.csv", lines, "time [s],velocity [rad/s],torque [N*m]\n"))
    assert r.w[1] == 2.5
    with pytest.raises(RecordingError, match="nominal torque"):
        read_recording(write(tmp_path / "b.csv", samples()))


def replaced(index: int, line: str) -> list[str]:
    lines = samples()
    lines[index] = line
    return lines


@pytest.mark.parametrize(
    ("lines", "said", "kept"),
    [
        (replaced(0, "0.000;50;-1200,,was 20.3"), "restored to 20.3", 20),
        (replaced(3, "30.000;50;9999.0"), "isolated torque", 19),
        (replaced(3, "30.000;50;nan"), "not finite", 19),
        (replaced(3, "30.000;50;"), "not finite", 19),
        (replaced(3, "30.000;50;20.0" + ";" * 5000), None, 20),
        (replaced(3, "30.000;50;20.0;7;8"), "more than 3 columns", 20),
        (replaced(3, ""), "blank", 19),
        (replaced(19, "190.0"), "cut off", 19),
        ([line.replace(".", ",") for line in samples()], "decimal comma", 20),
        (replaced(3, '30.000;"50";"20.4"'), None, 20),
        ([line + ",," for line in samples()], "commas added", 20),
        ([f"{1000 * k:,}.0;50;{20 + k % 3}.0" for k in range(20)], "thousands separators", 20),
    ],
)
def test_repairs_are_made_and_said(tmp_path, lines, said, kept):
    """Damaged lines are repaired or left out, and the recording reports every such change."""
    r = read(write(tmp_path / "a.csv", lines))
    assert len(r.time) == kept
    assert np.ptp(r.tau) < 0.1 * NOMINAL
    if said is None:
        assert r.repairs == ()
    else:
        assert any(said in repair for repair in r.repairs), r.repairs


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("time [s];velocity [rpm];torque [%]\n", "{t};{w};{tau}"),
        ('"time [s]";"velocity [rpm]";"torque [%]"\n', '"{t}";"{w},000";"{tau}"'),
        ("time [s];velocity [rpm];torque [%]\n", "{t};{w},0;{tau}"),
        ("time [s],velocity [rpm],torque [%]\n", '"{t}","{w}","{tau}"'),
        ("time [s],velocity [rpm],torque [%]\n", '"{t}",{w},"{tau}"'),
    ],
)
def test_decimal_commas_with_units_in_the_header_and_quoted(tmp_path, header, line):
    plain = read(write(tmp_path / "a.csv", samples()))
    fields = [sample.split(";") for sample in samples()]
    lines = [
        line.format(t=f"{float(t) / 1000:.3f}".replace(".", ","), w=w, tau=tau.replace(".", ","))
        for t, w, tau in fields
    ]
    r = read(write(tmp_path / "b.csv", lines, header))
    np.testing.assert_allclose([r.time, r.w, r.tau], [plain.time, plain.w, plain.tau], atol=1e-12)
    assert any("decimal comma" in repair for repair in r.repairs)


@pytest.mark.parametrize(
    ("header", "line"),
    [
        ("time [ms];velocity [rpm];torque [%]\n", "{t_dot};{w};{tau_comma}"),  # 1.000,000 ms
        ("time [ms];velocity [rpm];torque [%]\n", "{t_int_dot};{w};{tau_comma}"),  # 1.000 ms
        (
            "time [ms];velocity [rpm];torque [%]\n",
            "{t_int_comma};{w};{tau_comma}",
        ),  # 1,000 ms, but 20,1 %
        ("time [ms]\tvelocity [rpm]\ttorque [‰]\n", "{t_int_comma}\t{w}\t{permille}"),
        ("time [ms]\tvelocity [rpm]\ttorque [%]\r\n", "{t_swiss}\t{w}\t{tau}"),
        ("\ufefftime [ms];velocity [rpm];torque [%]\n", "{t_blank};{w};{tau_comma}"),
        ("time [ms];velocity [rpm];torque [mN*m]\n", "{t};{w};{fine_comma}"),
        ("time [ms];velocity [rpm];torque [N*m]\n", "{t};{w};{small_comma}"),
        ("time [ms];velocity [rpm];torque [%]\n", "{t};\u2212{w};\u2212{tau}"),
    ],
)
def test_marks_of_decimals_and_thousands_are_told_by_column(tmp_path, header, line):
    """The reader distinguishes decimal and thousands separators separately in each column."""
    lines, plain = [], []
    for k in range(300):
        t, tau = 10.0 * k, 20 + 0.1 * (k % 7)
        plain.append(f"{t:.3f};{50 + k % 3};{tau:.1f}")
        fields = {
            "t": f"{t:.3f}",
            "w": f"{50 + k % 3}",
            "tau": f"{tau:.1f}",
            "t_dot": f"{t:,.3f}".translate(SWAPPED),
            "t_int_dot": f"{t:,.0f}".replace(",", "."),
            "t_int_comma": f"{t:,.0f}",
            "t_swiss": f"{t:,.1f}".replace(",", "'"),
            "t_blank": f"{t:,.1f}".replace(",", "\u00a0").replace(".", ","),
            "tau_comma": f"{tau:.1f}".replace(".", ","),
            "permille": f"{10 * tau:.0f}",
            "fine_comma": f"{tau * 1e-2 * NOMINAL * 1e3:.4f}".replace(".", ","),
            "small_comma": f"{tau * 1e-2 * NOMINAL:.6e}".replace(".", ","),
        }
        lines.append(line.format(**fields))
    expected = read(write(tmp_path / "a.csv", plain))
    r = read(write(tmp_path / "b.csv", lines, header))
    np.testing.assert_allclose(r.time, expected.time, atol=1e-9)
    np.testing.assert_allclose(np.abs(r.w), expected.w)
    np.testing.assert_allclose(np.abs(r.tau), expected.tau, atol=1e-5 * NOMINAL)


@pytest.mark.parametrize(
    "line", ["10.5;50;20,1 %", "10.5;50;20,100", "10.5;50;20,1rpm", "10;5.204;20,100"]
)
def test_a_number_that_is_not_clear_is_refused(tmp_path, line):
    lines = [f"1{k}{line}" for k in range(20)]
    with pytest.raises(
        RecordingError, match=r"a\.csv:8: .*(is not a number|decimals or thousands)"
    ):
        read(write(tmp_path / "a.csv", lines))


def test_some_bare_decimal_commas_between_commas_are_refused_too(tmp_path):
    lines = [f"{10 * k},{50 + k % 3},{20 + k % 5}{',3' if k % 10 == 5 else ''}" for k in range(100)]
    with pytest.raises(RecordingError, match=r"a\.csv:7: more fields .* must be quoted"):
        read(write(tmp_path / "a.csv", lines, "time [ms],velocity [rpm],torque [%]\n"))
    lines = [f"{10 * k},{50 + k % 3},{20 + k % 5}{',3' if k == 50 else ''}" for k in range(100)]
    r = read(write(tmp_path / "b.csv", lines, "time [ms],velocity [rpm],torque [%]\n"))
    assert len(r.time) == 99
    assert any("left out" in repair for repair in r.repairs)


def test_bare_decimal_commas_between_commas_are_refused(tmp_path):
    lines = [sample.replace(".", ",").replace(";", ",") for sample in samples()]
    with pytest.raises(RecordingError, match="must be quoted"):
        read(write(tmp_path / "a.csv", lines, "time [ms],velocity [rpm],torque [%]\n"))


def test_doubtful_torque_is_remarked_and_only_that(tmp_path):
    """Implausible channels are reported, and no real recording gets such a report.

    Examples are a torque that stays constant, a torque in the wrong unit and a time in the wrong
    unit.
    """
    said = [r.repairs for r in read_recordings([RECORDINGS], nominal_torque=NOMINAL)]
    doubts = ("stays at", "does not change", "‰", "unit of time")
    assert not any(doubt in text for repairs in said for text in repairs for doubt in doubts)
    for rig in ("drive1_lead_screw", "drive3_worm"):
        lines = (
            (RECORDINGS / rig / "steady_state" / "40.csv")
            .read_text(encoding="utf-8-sig")
            .splitlines()
        )
        first = next(k for k, line in enumerate(lines) if line.startswith("ms;")) + 1
        rows = [line.split(";") for line in lines[first:]]
        tenfold = [f"{t};{w};{10 * float(tau):.0f}" for t, w, tau in rows]
        r = read(write(tmp_path / "a.csv", tenfold, "\n".join(lines[:first]) + "\n"))
        assert any("‰" in text for text in r.repairs)
        most = round(float(np.quantile([abs(float(tau)) for _, _, tau in rows], 0.9)), 1)
        for altered, said in (
            (lambda k, tau: 40.0 if 100 <= k < 200 else tau, "stays at its largest"),
            (lambda k, tau: -40.0 if 100 <= k < 200 else tau, "stays at its largest"),
            (
                lambda k, tau: 40.0 + 0.1 * (k % 2) if 100 <= k < 200 else tau,
                "stays at its largest",
            ),
            (lambda _, tau: max(min(tau, most), -most), "stays at its largest"),  # noqa: B023
            (lambda k, tau: -7.3 if 100 <= k < 200 else tau, "does not change for 100 samples"),
        ):
            stuck = [f"{t};{w};{altered(k, float(tau)):.1f}" for k, (t, w, tau) in enumerate(rows)]
            r = read(write(tmp_path / "b.csv", stuck, "\n".join(lines[:first]) + "\n"))
            assert any(said in text for text in r.repairs), said
        seconds = [f"{float(t) / 1000};{w};{tau}" for t, w, tau in rows]
        r = read(write(tmp_path / "c.csv", seconds, "\n".join(lines[:first]) + "\n"))
        assert any("unit of time" in text for text in r.repairs)
        swept = [f"{t};{0.4 * k};{tau}" for k, (t, _, tau) in enumerate(rows)]
        data = compute_torque_map(
            [read(write(tmp_path / "d.csv", swept, "\n".join(lines[:first]) + "\n"))]
        )
        assert any("not steady" in text for text in data.repairs)


def test_fewer_samples_than_promised_is_said(tmp_path):
    r = read(write(tmp_path / "a.csv", samples(), HEADER.format(count=500)))
    assert any("promises 500" in repair for repair in r.repairs)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "empty"),
        (b"\n \n", "empty"),
        (bytes(range(256)) * 40, "not a text file"),
        (b"time;velocity;torque\n" + b"1;" * 100_000, "too long for a table"),
        (b"just some words\nand more\n", "no line of channel names"),
        (b"a;b;c\n1;2;3\n", "channel names"),
        (HEADER.encode(), "no sample"),
        ((HEADER + "\n".join(samples(3))).encode(), "3 samples"),
        ((HEADER.replace("rpm", "furlong") + "\n".join(samples())).encode(), "furlong"),
        ((HEADER.replace("ms;rpm;%", "ms;rpm;V") + "\n".join(samples())).encode(), "allowed: %"),
        (b"time,velocity,torque\n" + b"\n".join(b"%d,1,2" % k for k in range(20)), "no unit"),
        (
            b"time [s],velocity [rpm]\n" + b"\n".join(b"%d,1" % k for k in range(20)),
            "no torque column",
        ),
        (
            (HEADER + "\n".join(replaced(5, "20.0;50;20.0"))).encode(),
            r"a\.csv:13: time does not increase",
        ),
        (
            (HEADER + "\n".join(replaced(5, "50.0;50;twenty"))).encode(),
            r"a\.csv:13: 'twenty' is not a number",
        ),
        (
            (HEADER + "\n".join(line.rsplit(";", 1)[0] + ";nan" for line in samples())).encode(),
            "not finite",
        ),
        (
            (HEADER + "\n".join(line.rsplit(";", 1)[0] + ";20.0" for line in samples())).encode(),
            "constant",
        ),
    ],
)
def test_an_unusable_recording_is_refused_with_a_message(tmp_path, content, message):
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        read(path)


def test_huge_and_missing_files_are_refused_at_once(tmp_path):
    path = tmp_path / "huge.csv"
    with path.open("wb") as stream:
        stream.truncate(1_000_000_000)
    with pytest.raises(RecordingError, match=f"too large .*at most {MAX_BYTES // 1_000_000} MB"):
        read(path)
    with pytest.raises(RecordingError, match="no such file"):
        read(tmp_path / "absent.csv")
    (tmp_path / "folder").mkdir()
    with pytest.raises(RecordingError, match=r"no \.csv"):
        read_recordings([tmp_path / "folder"])


def test_spikes_are_isolated_samples_only():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=500)
    assert len(find_spikes(noise)) == 0
    assert len(find_spikes(np.concatenate([noise, 30 + noise]))) == 0
    noise[[7, 300]] = (-400.0, 250.0)
    assert find_spikes(noise).tolist() == [7, 300]
    noise[[0, 499]] = 250.0
    assert find_spikes(noise).tolist() == [0, 7, 300, 499]
    noise[[8, 301]] = noise[[7, 300]]
    assert find_spikes(noise).tolist() == [0, 499]  # Two equal samples in a row are no spike.


def test_slow_motion_below_the_resolution_is_not_rest():
    time = np.arange(40) * 0.1
    creeping = np.where(np.arange(40) % 4 == 0, 0.1, 0.0)
    assert not rest_mask(time, creeping)[:37].any()
    stopped = np.concatenate([np.ones(10), np.zeros(20), -np.ones(10)])
    assert rest_mask(time, stopped).sum() == 20
    assert rest_mask(time, np.concatenate([np.ones(20), [0.0], -np.ones(19)])).sum() == 1
    flickering = np.concatenate([20.0 * np.ones(10), np.zeros(20), 20.0 * np.ones(10)])
    flickering[[15, 22]] = (0.1, -0.1)
    assert rest_mask(time, flickering).sum() == 20


@pytest.mark.parametrize("rig", ["drive1_lead_screw", "drive2_antibacklash_screw", "drive3_worm"])
def test_every_real_recording_is_read_and_told_apart(rig):
    """Every real recording is read, and steady and start-stop recordings are distinguished."""
    steady = read_recordings(
        [RECORDINGS / rig / "steady_state"], nominal_torque=NOMINAL, direction=-1
    )
    moving = read_recordings(
        [RECORDINGS / rig / "start_stop"], nominal_torque=NOMINAL, direction=-1
    )
    assert {recording_kind(r) for r in steady} == {"steady"}
    assert {recording_kind(r) for r in moving} == {"start_stop"}
    assert all(len(r.time) == 500 for r in (*steady, *moving))
    points = compute_torque_map(steady)
    commanded = np.array([float(n.removesuffix(".csv").replace("n", "-")) for n in points.names])
    np.testing.assert_allclose(points.w, -commanded * -RPM, rtol=0.1)
    edited = {r.name for r in steady if any("restored" in repair for repair in r.repairs)}
    assert edited == ({"1.csv", "2.csv", "n1.csv"} if rig == "drive3_worm" else set())


def test_missing_samples_are_stated(tmp_path: Path) -> None:
    every = np.arange(200)
    remaining = every[np.random.default_rng(0).random(200) > 0.3]
    for name, samples in (("gaps", remaining), ("whole", every)):
        rows = [f"{0.01 * k:.2f};{100 + k % 3};{30 + k % 7}" for k in samples]
        text = "time [s];velocity [rpm];torque [%]\n" + "\n".join(rows)
        (tmp_path / name).write_text(text, encoding="utf-8")
    gaps, complete = (
        read_recording(tmp_path / name, nominal_torque=1e-3) for name in ("gaps", "whole")
    )
    missing = remaining[-1] - remaining[0] + 1 - len(remaining)
    assert f"about {missing} samples are missing" in gaps.repairs[-1]
    assert not any("missing" in repair for repair in complete.repairs)


@pytest.mark.parametrize("separator", [";", ",", "\t"])
@pytest.mark.parametrize("comment", ["", "rig; bench\n", "rig, bench\n"])
def test_the_line_of_names_tells_the_separator(
    tmp_path: Path, separator: str, comment: str
) -> None:
    rows = [["time [s]", "velocity [rpm]", "torque [%]"]]
    rows += [[f"{0.01 * k:.2f}", f"{100 + k % 3}", f"{30 + k % 7}"] for k in range(50)]
    text = comment + "\n".join(separator.join(row) for row in rows)
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    recording = read_recording(tmp_path / "a.csv", nominal_torque=1e-3)
    assert recording.tau[:3].tolist() == pytest.approx([3e-4, 3.1e-4, 3.2e-4])
