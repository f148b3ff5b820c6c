"""Stage, balance and control service, over the wire that the rig uses."""

import xmlrpc.client

import pytest
import serial

from sim_hardware.instruments.balance import Balance
from sim_hardware.instruments.stage import MICROSTEP_UM, Stage


class Line:
    """A serial device by address, line by line."""

    def __init__(self, url):
        self.port = serial.serial_for_url(url, timeout=5)

    def ask(self, command):
        self.port.write(command.encode() + b"\r\n")
        return self.port.readline().decode()


@pytest.fixture
def wired(virtual):
    lines = {name: Line(virtual.services.addresses[name]) for name in ("stage", "balance")}
    with xmlrpc.client.ServerProxy(virtual.services.addresses["control"]) as control:
        lines["control"] = control
        lines["bench"] = virtual
        yield lines
    for name in ("stage", "balance"):
        lines[name].port.close()


# ---- Z stage


def test_the_stage_homes_moves_and_says_when_it_is_there(wired):
    stage, control = wired["stage"], wired["control"]
    assert stage.ask("/1") == "@01 0 OK IDLE WR 0\r\n"
    assert stage.ask("/1 home") == "@01 0 OK IDLE -- 0\r\n"
    target = round(800 / MICROSTEP_UM)
    assert stage.ask(f"/1 move abs {target}") == "@01 0 OK BUSY -- 0\r\n"
    control.sleep(0.1)
    assert 0 < int(stage.ask("/1 get pos").split()[-1]) < target
    control.sleep(0.5)
    assert stage.ask("/1 get pos") == f"@01 0 OK IDLE -- {target}\r\n"
    kind, details = wired["bench"].world.requests[-1]
    assert kind == "turn_micrometer"
    assert details["position_um"] == pytest.approx(800, abs=MICROSTEP_UM)


def test_a_stopped_stage_stays_where_it_is(wired):
    stage = wired["stage"]
    stage.ask("/1 home")
    stage.ask("/1 move abs 40000")
    wired["control"].sleep(0.4)
    stage.ask("/1 stop")
    at = int(stage.ask("/1 get pos").split()[-1])
    assert 10_000 < at < 30_000
    assert wired["bench"].world.requests[-1][1]["position_um"] == pytest.approx(at * MICROSTEP_UM, abs=0.1)


@pytest.mark.parametrize(
    ("command", "reply"),
    [
        ("/1 move abs -1", "RJ IDLE -- BADDATA"),
        ("/1 move abs 99999999", "RJ IDLE -- BADDATA"),
        ("/1 move abs 1.5", "RJ IDLE -- BADDATA"),
        ("/1 set maxspeed 0", "RJ IDLE -- BADDATA"),
        ("/1 dance", "RJ IDLE -- BADCOMMAND"),
        ("/1 get moon", "RJ IDLE -- BADCOMMAND"),
        ("/1 2 home", "RJ IDLE -- BADAXIS"),
        ("/1 0 7 get limit.max", "07 OK IDLE -- 533333"),
        ("/get pos", "OK IDLE -- 0"),
    ],
)
def test_the_stages_replies(command, reply):
    stage = Stage(lambda: 0.0, lambda position_um: None)
    stage.answer("/1 home")
    assert stage.answer(command) == [f"@01 {2 if 'BADAXIS' in reply else 0} {reply}"]


def test_the_stage_is_silent_to_others_and_refuses_to_move_before_homing():
    stage = Stage(lambda: 0.0, lambda position_um: None)
    assert stage.answer("/2 home") == []
    assert stage.answer("home") == []
    assert stage.answer("/1 move abs 100") == ["@01 0 RJ IDLE WR BADDATA"]


# ---- balance


def test_the_balance_weighs_what_is_put_on_it(wired):
    balance, control = wired["balance"], wired["control"]
    assert balance.ask("Z") == "Z A\r\n"
    assert control.request("place_on_balance", {"mass_g": 5.0}) == "5 g on the balance"
    assert balance.ask("SI").startswith("S D ")
    reply = balance.ask("S")
    assert reply[:4] == "S S "
    assert reply.endswith(" g\r\n")
    assert len(reply) == len("S S      5.0000 g\r\n")
    assert float(reply.split()[2]) == pytest.approx(5.0, abs=1e-3)
    assert control.request("place_on_balance", {"mass_g": 0}) == "balance cleared"
    assert float(balance.ask("S").split()[2]) == pytest.approx(0.0, abs=1e-3)


def test_the_balance_overloads_and_knows_its_commands():
    balance = Balance(lambda: 100.0, lambda duration_s: None)
    assert balance.answer("X") == ["ES"]
    assert balance.answer("@") == balance.answer("I4")
    assert balance.answer("I0")[-1] == 'I0 A 0 "ZI"'
    balance.put(500.0)
    assert balance.answer("SI") == ["S +"]
    with pytest.raises(ValueError, match="mass"):
        balance.put(-1.0)


# ---- control


def test_the_control_service_keeps_the_clock_and_passes_requests_on(wired):
    control, world = wired["control"], wired["bench"].world
    before = control.time_s()
    assert control.sleep(120.0) == pytest.approx(before + 120.0)
    assert (
        control.request("place_finger", {"finger": "index", "site": "a", "repeat": 1}) == "place_finger done"
    )
    assert world.requests == [("place_finger", {"finger": "index", "site": "a", "repeat": 1})]
    assert control.arm() == {"command_v": 0.0, "in_contact": False}
    assert control.truth() == {"seed": str(2**40), "zeros": [1.0, 2.0], "pair": [1, None]}


@pytest.mark.parametrize(
    ("call", "arguments", "says"),
    [
        ("request", ("impossible", {}), "can't be done"),
        ("request", ("place_on_balance", {}), "mass_g"),
        ("fault", ("earthquake", {}), "unknown fault"),
        ("fault", ("stall", {}), "duration_s"),
        ("fault", ("late_start", {"samples": -1}), "samples"),
        ("sleep", (-1.0,), "duration_s"),
        ("sleep", ("soon",), "duration_s"),
        ("arm", (1, 2), "arm"),
    ],
)
def test_bad_requests_come_back_in_one_line(wired, call, arguments, says):
    with pytest.raises(xmlrpc.client.Fault) as fault:
        getattr(wired["control"], call)(*arguments)
    assert says in fault.value.faultString
    assert "\n" not in fault.value.faultString


def test_faults_are_ordered_by_the_control_service(wired):
    control, card = wired["control"], wired["bench"].card
    control.fault("late_start", {"samples": 12})
    control.fault("coerce_rate", {"rate_hz": 7999.5})
    control.fault("unplug", {})
    assert (card.late_start_samples, card.coerced_rate_hz, card.present) == (12, 7999.5, False)
    control.fault("coerce_rate", {"rate_hz": 0})
    control.fault("replug", {})
    assert (card.coerced_rate_hz, card.present) == (None, True)
