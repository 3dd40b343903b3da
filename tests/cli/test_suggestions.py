"""What a message suggests to type is accepted when it is typed, and ranges have the user's units."""

from __future__ import annotations

import csv
import re
from argparse import ArgumentTypeError

import numpy as np
import pytest

from ssm_planner.cli import main
from ssm_planner.cli.shared import ARGUMENTS, VALUE_TYPES, quantity_argument, rate_argument
from ssm_planner.units import QUANTITY_KINDS, BadQuantity, parse_quantity

with ARGUMENTS.open(encoding="utf-8", newline="") as file:
    QUANTITIES = [
        row
        for row in csv.DictReader(file)
        if row["kind"] in QUANTITY_KINDS and row["kind"] not in VALUE_TYPES
    ]


def message_of(convert: object, text: str) -> str:
    """Return the message about a wrong value."""
    with pytest.raises(ArgumentTypeError) as caught:
        convert(text)  # type: ignore[operator]
    return str(caught.value)


@pytest.mark.parametrize("wrong", ["x", "1", "1 furlong", "1e300deg"])
@pytest.mark.parametrize(
    "row", QUANTITIES, ids=[f"{row['commands']} {row['argument']}" for row in QUANTITIES]
)
def test_the_values_that_an_option_suggests_are_accepted(row: dict[str, str], wrong: str) -> None:
    convert = quantity_argument(row["kind"], row["range"])
    allowed = message_of(convert, wrong).partition("(allowed: ")[2].rstrip(")")
    examples = allowed.split(" to ") if row["range"] else [allowed.rpartition("such as ")[2]]
    examples += re.findall(r"(?:such as|default:) (-?\d\S*?)[,)]?(?= |$)", row["help"])
    assert examples
    for example in examples:
        assert " " not in example
        assert np.isfinite(convert(example))


def test_the_rate_that_a_message_suggests_is_accepted() -> None:
    examples = re.findall(r"\d+k?Hz|\d+(?= or)", message_of(rate_argument, "x"))
    assert examples
    for example in examples:
        assert VALUE_TYPES["rate"](example) > 0


@pytest.mark.parametrize("kind", QUANTITY_KINDS)
def test_the_example_of_a_quantity_is_accepted(kind: str) -> None:
    with pytest.raises(BadQuantity) as caught:
        parse_quantity("x", kind)
    examples = caught.value.allowed.rpartition("such as ")[2].split(" or ")
    for text in examples:
        example = float(text) if kind == "number" else text
        assert np.isfinite(parse_quantity(example, kind))


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("ik vitreoretinal --tilt 300deg", "'300deg': out of range (allowed: -180deg to 180deg)"),
        ("workspace --reach -300deg 0deg", "'-300deg': out of range (allowed: -180deg to 180deg)"),
        ("workspace --reach -9deg 0deg --margin -5deg", "(allowed: 0deg to 180deg)"),
        ("size plan --ambient 500degC", "'500degC': out of range (allowed: -70degC to 125degC)"),
        ("retract", "unknown command 'retract' (one of"),
    ],
)
def test_a_message_has_the_units_of_the_user(
    command: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command.split()) == 2
    error = capsys.readouterr().err
    assert message in error
    assert " rad" not in error
