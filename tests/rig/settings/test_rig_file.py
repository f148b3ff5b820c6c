"""Rig files: what is taken, and the one line that says what is wrong with the rest."""

from __future__ import annotations

import re
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from analysis.errors import BadInputError
from rig.settings.protocol_file import Study
from rig.settings.reading import check_protocol_on_rig, load_rig, parse_rig
from rig.settings.rig_file import RigFile

COMPANION = '[companion]\ncommand = ["x"]\n'

BROKEN = {
    "unknown table": ("[cart]\n", "cart: unknown key; did you mean card?"),
    "unknown key": ("[card]\nadress = ''", "card.adress: unknown key; did you mean address?"),
    "wrong unit": (
        "[lever]\ntravel_max_um = 9500",
        "lever.travel_max_um: unknown key; did you mean travel_max_mm?",
    ),
    "key out of place": ("sample_rate_hz = 8000", "sample_rate_hz: unknown key"),
    "text for a number": ('[lever]\ntravel_max_mm = "9 mm"', "its unit stands in the key's name"),
    "truth for a number": ("[lever]\ntravel_max_mm = true", "write a bare number"),
    "number for text": ("[card]\ndevice = 1", "put it in quotes"),
    "number for a table": ("card = 1", "write it as a table"),
    "number for truth": ("[guard]\nenabled = 1", "write true or false"),
    "nan": ("[lever]\nspeed_max_mm_s = nan", "finite number"),
    "inf": ("[lever]\nspeed_max_mm_s = inf", "finite number"),
    "travel beyond the lever's": (
        "[lever]\ntravel_max_mm = 10.5",
        "lever.travel_max_mm = 10.5: should be less",
    ),
    "negative travel": ("[lever]\ntravel_min_mm = -1", "lever.travel_min_mm = -1: should be greater"),
    "travel turned round": ("[lever]\ntravel_min_mm = 5\ntravel_max_mm = 4", "swap them"),
    "force beyond the lever's": ("[lever]\nforce_max_mn = 501", "lever.force_max_mn = 501"),
    "no force allowed": ("[lever]\nforce_max_mn = 0", "lever.force_max_mn = 0"),
    "no speed allowed": ("[lever]\nspeed_max_mm_s = 0", "lever.speed_max_mm_s = 0"),
    "safety out of reach": ("[lever]\nsafe_position_mm = 9.8", "outside the travel"),
    "retreat too fast": ("[lever]\nretreat_speed_mm_s = 200", "above speed_max_mm_s"),
    "no sensitivity": ("[calibration]\nvolts_per_mn = 0", "must not be 0"),
    "zero that leaves no volts": ("[calibration]\ncommand_zero_v = 0.0", "beyond the card's +-10 V"),
    "one input for two": ('[card]\nforce_channel = "ai0"', "not all different"),
    "loop-back on a used input": ('[card]\nloopback_channel = "ai1"', "not all different"),
    "output for an input": ('[card]\nforce_channel = "ao1"', "are inputs"),
    "input for an output": ('[card]\ncommand_channel = "ai3"', "is an output"),
    "no such kind of channel": ('[card]\nforce_channel = "port0"', "card.force_channel = 'port0'"),
    "device with a path": ('[card]\ndevice = "Dev1/ai0"', "card.device = 'Dev1/ai0'"),
    "rate of nothing": ("[card]\nsample_rate_hz = 0", "card.sample_rate_hz = 0"),
    "range beyond the card's": ("[card]\nrange_v = 20", "card.range_v = 20"),
    "buffer of nothing": ("[card]\ninput_buffer_s = 0.1", "card.input_buffer_s = 0.1"),
    "stage without a port": ("[stage]\nbaud_rate = 9600", "stage.port: missing; add it"),
    "baud rate that is none": ('[stage]\nport = "x"\nbaud_rate = 1', "stage.baud_rate = 1"),
    "half a microstep count": ('[stage]\nport = "x"\ndevice_number = 1.5', "write a whole number"),
    "companion unnamed": ('[card]\naddress = "companion:card"', "there is no [companion] table"),
    "stage at a companion unnamed": (
        '[stage]\nport = "companion:stage"',
        "stage.port = 'companion:stage' but",
    ),
    "companion without a command": ("[companion]\nstart_timeout_s = 3.0", "companion.command: missing"),
    "command as one text": ('[companion]\ncommand = "python -m x"', "write a list"),
    "empty command": ("[companion]\ncommand = []", "companion.command = ()"),
    "operator at a port": ('[operator]\naddress = "COM3"', "operator.address = 'COM3'"),
    "clock without an address": ("[clock]\n", "clock.address: missing"),
    "impatient guard": ("[guard]\nheartbeat_timeout_s = 0.01", "guard.heartbeat_timeout_s = 0.01"),
    "punch of nothing": ("[punch]\ndiameter_mm = 0", "punch.diameter_mm = 0"),
    "not TOML": ("[card\n", "not valid TOML"),
    "a key twice": ("[card]\nrange_v = 10.0\nrange_v = 10.0", "not valid TOML"),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_file_is_told_in_one_line(fault: str, tmp_path: Path) -> None:
    text, words = BROKEN[fault]
    path = tmp_path / "rig.toml"
    path.write_text(text)
    with pytest.raises(BadInputError) as caught:
        load_rig(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert words in said
    assert "\n" not in said


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00", "folder"])
def test_a_file_that_cannot_be_read_is_told(content: bytes | str | None, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    if content == "folder":
        path.mkdir()
    elif isinstance(content, bytes):
        path.write_bytes(content)
    with pytest.raises(BadInputError, match=r"rig\.toml: ") as caught:
        load_rig(path)
    assert "\n" not in str(caught.value)


def test_the_example_explains_every_key_with_its_default() -> None:
    text = (files("rig.examples") / "rig.toml").read_text()
    assert parse_rig(text, "rig.toml") == RigFile()
    for table, default in RigFile():
        keys = type(default).model_fields if isinstance(default, BaseModel) else {}
        for key in keys:
            assert f"{key} = " in text or f"[{table}.{key}]" in text, f"{table}.{key}"


def test_what_the_example_has_as_a_comment_can_be_taken() -> None:
    lines = (files("rig.examples") / "rig.toml").read_text().splitlines()
    keys = re.compile(r"# (\[|\w+ = )")
    opened = [line.removeprefix("# ") if keys.match(line) else line for line in lines]
    rig = parse_rig("\n".join(opened), "rig.toml")
    assert rig.stage is not None
    assert rig.balance is not None
    assert rig.card.loopback_channel == "ai2"
    assert rig.companion is not None


def test_the_simulated_rig_differs_by_address_only() -> None:
    rig = parse_rig((files("rig.examples") / "simulated_rig.toml").read_text(), "simulated_rig.toml")
    assert set(rig.addresses().values()) == {
        "companion:card",
        "companion:stage",
        "companion:balance",
        "companion:control",
    }
    assert rig.lever == RigFile().lever
    assert rig.calibration == RigFile().calibration


def test_a_signal_may_come_with_its_sign_turned_where_the_lever_is_stated_so() -> None:
    turned = "[calibration]\nvolts_per_mn = -0.015\n"
    with pytest.raises(BadInputError, match=r"volts_per_mn = -0.015 is not within 20% of the lever's 0.015"):
        parse_rig(turned, "rig.toml")
    rig = parse_rig("[lever]\nnominal_volts_per_mn = -0.015\n" + turned, "rig.toml")
    assert rig.calibration.nominal().volts_per_mn == -0.015


@pytest.mark.parametrize(
    "line",
    ["volts_per_mm = 20.42", "command_volts_per_mm = -2.042", "volts_per_mn = 0.15", "volts_per_mn = 0.0005"],
)
def test_constants_that_are_no_such_levers_are_refused(line: str) -> None:
    with pytest.raises(BadInputError, match="is not within 20%"):
        parse_rig(f"[calibration]\n{line}\n", "rig.toml")


def test_a_companions_settings_are_its_own() -> None:
    rig = parse_rig(COMPANION + "[companion.settings.any.thing]\nx = [1, {y = 2}]\n", "rig.toml")
    assert rig.companion is not None
    assert rig.companion.settings == {"any": {"thing": {"x": (1, {"y": 2})}}}


def test_a_file_once_read_does_not_change() -> None:
    with pytest.raises(ValueError, match="frozen"):
        RigFile().lever.travel_max_mm = 10.0  # type: ignore[misc]


@given(st.floats(allow_nan=True, allow_infinity=True) | st.integers() | st.text() | st.booleans())
def test_whatever_a_limit_is_set_to_is_taken_or_told(value: object) -> None:
    text = f"[lever]\nforce_max_mn = {toml_value(value)}\n"
    if not parses(text):
        return
    try:
        rig = parse_rig(text, "rig.toml")
    except BadInputError as error:
        assert str(error).startswith("rig.toml: lever.force_max_mn = ")
        assert "\n" not in str(error)
    else:
        assert 0 < rig.lever.force_max_mn <= 500


def toml_value(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value)


def parses(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ("speed_max_mm_s = 3.0\nretreat_speed_mm_s = 2.0", "indentation.ramp_speed_mm_s = 5: "),
        (
            "travel_min_mm = 4.0\ntravel_max_mm = 4.5\nsafe_position_mm = 4.1",
            "depth_mm = 0.6: beyond this rig's travel",
        ),
        ("depth_max_mm = 0.5", "depth_mm = 0.6: deeper than this rig's lever.depth_max_mm = 0.5"),
        ("approach_speed_max_mm_s = 0.5", "surface.approach_speed_mm_s = 1: faster than"),
        ("force_max_mn = 8.0", "surface.contact_threshold_mn = 10: not below"),
    ],
)
def test_a_protocol_that_asks_too_much_of_a_rig_is_told(limit: str, words: str) -> None:
    rig = parse_rig(f"[lever]\n{limit}\n", "rig.toml")
    study = Study(kind="study")
    check_protocol_on_rig(study, RigFile(), "study.toml")
    with pytest.raises(BadInputError, match=r"^study\.toml: ") as caught:
        check_protocol_on_rig(study, rig, "study.toml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
