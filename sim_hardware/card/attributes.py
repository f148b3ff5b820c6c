"""The driver's properties that the card knows, by the call that gets or sets them and their number."""

from collections.abc import Callable
from typing import Any

from sim_hardware.card.card import Card
from sim_hardware.card.channels import DEVICE, N_CHANNELS, RANGE_V, Channel, parse_terminal
from sim_hardware.card.errors import CardError, Code
from sim_hardware.card.plant import SAMPLE_RATE_HZ
from sim_hardware.card.task import CardTask, Timing

Getter = Callable[[Card, CardTask], Any]
Setter = Callable[[Card, CardTask, Any], None]

DRIVER_VERSION = (23, 8, 0)
FIFO_SAMPLES = 4096
_ON_DEMAND, _SAMPLE_CLOCK = 10390, 10388
_NO_TRIGGER, _DIGITAL_EDGE = 10230, 10150
_ANALOG_INPUT, _ANALOG_OUTPUT = 10100, 10102
_VOLTAGE = 10322
_ALLOW_REGENERATION, _NO_REGENERATION = 10097, 10158


def not_supported(attribute: int) -> CardError:
    """The driver's answer to a property it does not have here (-200452)."""
    return CardError(Code.PROPERTY_NOT_SUPPORTED, f"Property: {attribute:#x}.")


def _timing(task: CardTask) -> Timing:
    if task.timing is None:
        raise CardError(Code.PROPERTY_NOT_SUPPORTED, "The task has no sample clock.")
    return task.timing


def _names(task: CardTask) -> str:
    return ", ".join(channel.name for channel in task.channels)


def _input(getter: Getter) -> Getter:
    """`getter` for input tasks; others are told that the property is not theirs."""

    def checked(card: Card, task: CardTask) -> Any:
        task.need("ai")
        return getter(card, task)

    return checked


def _output(getter: Getter) -> Getter:
    def checked(card: Card, task: CardTask) -> Any:
        task.need("ao")
        return getter(card, task)

    return checked


def _available(card: Card, task: CardTask) -> int:
    task.check()
    return min(task.ring.available, task.ring.size) if task.ring is not None else 0


def samples_to_read(card: Card, task: CardTask) -> int:
    """What "read all available" means: all there is (continuous), all there will be (finite)."""
    if task.timing is None:
        return 1
    if task.finite and not task.read_all_available:
        return task.timing.n_samples - (task.ring.read_position if task.ring is not None else 0)
    return _available(card, task)


def _space(card: Card, task: CardTask) -> int:
    task.check()
    return task.queue.room if task.queue is not None else task.output_size()


def _regeneration(card: Card, task: CardTask) -> int:
    return _ALLOW_REGENERATION if task.regenerate else _NO_REGENERATION


GETTERS: dict[str, dict[int, Getter]] = {
    "GetTaskAttributeString": {
        0x1276: lambda card, task: task.name,
        0x1273: lambda card, task: _names(task),
        0x230E: lambda card, task: DEVICE if task.channels else "",
    },
    "GetTaskAttributeUInt32": {
        0x2181: lambda card, task: len(task.channels),
        0x29BA: lambda card, task: 1 if task.channels else 0,
    },
    "GetTaskAttributeBool": {0x1274: lambda card, task: card.is_done(task)},
    "GetTimingAttributeDouble": {
        0x1344: lambda card, task: _timing(task).rate_hz,
        0x22C8: lambda card, task: SAMPLE_RATE_HZ,
    },
    "GetTimingAttributeInt32": {
        0x1300: lambda card, task: _timing(task).mode,
        0x1347: lambda card, task: _ON_DEMAND if task.timing is None else _SAMPLE_CLOCK,
    },
    "GetTimingAttributeUInt64": {0x1310: lambda card, task: _timing(task).n_samples},
    "GetTimingAttributeString": {
        0x1852: lambda card, task: (
            f"/{DEVICE}/{_timing(task).clock}" if _timing(task).clock else "OnboardClock"
        ),
        0x2F1B: lambda card, task: f"/{DEVICE}/{_timing(task).clock or task.direction + '/SampleClock'}",
    },
    "GetTrigAttributeInt32": {
        0x1393: lambda card, task: _DIGITAL_EDGE if task.start_trigger else _NO_TRIGGER,
    },
    "GetTrigAttributeString": {
        0x1407: lambda card, task: f"/{DEVICE}/{task.start_trigger}" if task.start_trigger else "",
        0x2F1E: lambda card, task: f"/{DEVICE}/{task.start_trigger or task.direction + '/StartTrigger'}",
    },
    "GetBufferAttributeUInt32": {
        0x186C: _input(lambda card, task: task.input_size()),
        0x186D: _output(lambda card, task: task.output_size()),
        0x230A: _input(lambda card, task: FIFO_SAMPLES),
        0x230B: _output(lambda card, task: FIFO_SAMPLES),
    },
    "GetReadAttributeUInt32": {
        0x217B: _input(lambda card, task: len(task.channels)),
        0x1223: _input(_available),
        0x31E8: _input(samples_to_read),
    },
    "GetReadAttributeUInt64": {
        0x192A: _input(lambda card, task: task.ring.acquired if task.ring else 0),
        0x1221: _input(lambda card, task: task.ring.read_position if task.ring else 0),
    },
    "GetReadAttributeInt32": {0x1211: _input(lambda card, task: task.overwrite_mode)},
    "GetReadAttributeBool": {0x1215: _input(lambda card, task: task.read_all_available)},
    "GetReadAttributeString": {0x1823: _input(lambda card, task: _names(task))},
    "GetWriteAttributeUInt32": {
        0x217E: _output(lambda card, task: len(task.channels)),
        0x1460: _output(_space),
    },
    "GetWriteAttributeUInt64": {
        0x192B: _output(lambda card, task: task.queue.generated if task.queue else 0),
        0x1458: _output(lambda card, task: task.queue.written if task.queue else 0),
    },
    "GetWriteAttributeInt32": {0x1453: _output(_regeneration)},
}


def _set_rate(card: Card, task: CardTask, value: float) -> None:
    old = _timing(task)
    card.set_timing(task, Timing(value, old.mode, old.n_samples, old.clock))


def _set_mode(card: Card, task: CardTask, value: int) -> None:
    old = _timing(task)
    card.set_timing(task, Timing(old.rate_hz, value, old.n_samples, old.clock))


def _set_count(card: Card, task: CardTask, value: int) -> None:
    old = _timing(task)
    card.set_timing(task, Timing(old.rate_hz, old.mode, value, old.clock))


def _set_clock(card: Card, task: CardTask, value: str) -> None:
    old = _timing(task)
    card.set_timing(task, Timing(old.rate_hz, old.mode, old.n_samples, parse_terminal(value)))


def _set_input_size(card: Card, task: CardTask, value: int) -> None:
    task.refuse_while_running()
    task.need("ai")
    task.input_buffer_samples = value


def _set_output_size(card: Card, task: CardTask, value: int) -> None:
    task.refuse_while_running()
    task.need("ao")
    task.output_buffer_samples = value
    task.queue = None  # a new buffer is an empty one


def _set_regeneration(card: Card, task: CardTask, value: int) -> None:
    task.need("ao")
    task.refuse_while_running()
    if value not in {_ALLOW_REGENERATION, _NO_REGENERATION}:
        raise CardError(Code.INVALID_VALUE, f"Regeneration Mode: {value}.")
    task.regenerate = value == _ALLOW_REGENERATION
    if task.queue is not None:
        task.queue.regenerate = task.regenerate


def _set_overwrite(card: Card, task: CardTask, value: int) -> None:
    task.need("ai")
    task.overwrite_mode = value


def _set_read_all(card: Card, task: CardTask, value: bool) -> None:
    task.need("ai")
    task.read_all_available = value


SETTERS: dict[str, dict[int, Setter]] = {
    "SetTimingAttributeDouble": {0x1344: _set_rate},
    "SetTimingAttributeInt32": {0x1300: _set_mode},
    "SetTimingAttributeUInt64": {0x1310: _set_count},
    "SetTimingAttributeString": {0x1852: _set_clock},
    "SetTrigAttributeString": {0x1407: lambda card, task, value: card.set_start_trigger(task, value)},
    "SetBufferAttributeUInt32": {0x186C: _set_input_size, 0x186D: _set_output_size},
    "SetWriteAttributeInt32": {0x1453: _set_regeneration},
    "SetReadAttributeInt32": {0x1211: _set_overwrite},
    "SetReadAttributeBool": {0x1215: _set_read_all},
}

CHANNEL_GETTERS: dict[str, dict[int, Callable[[Channel], Any]]] = {
    "GetChanAttributeInt32": {
        0x187F: lambda channel: _ANALOG_INPUT if channel.direction == "ai" else _ANALOG_OUTPUT,
        0x0695: lambda channel: _VOLTAGE,
        0x1108: lambda channel: _VOLTAGE,
    },
    "GetChanAttributeDouble": {
        0x17DD: lambda channel: channel.max_v,
        0x17DE: lambda channel: channel.min_v,
        0x1186: lambda channel: channel.max_v,
        0x1187: lambda channel: channel.min_v,
        0x1815: lambda channel: RANGE_V,
        0x1816: lambda channel: -RANGE_V,
    },
    "GetChanAttributeString": {0x18F5: lambda channel: channel.physical},
}

SYSTEM: dict[str, dict[int, Any]] = {
    "GetSystemInfoAttributeUInt32": {
        0x1272: DRIVER_VERSION[0],
        0x1923: DRIVER_VERSION[1],
        0x2F22: DRIVER_VERSION[2],
    },
    "GetSystemInfoAttributeString": {0x193B: DEVICE},
}

DEVICE_PROPERTIES: dict[str, dict[int, Any]] = {
    "GetDeviceAttributeString": {
        0x0631: "PCI-6120",
        0x231E: ", ".join(f"{DEVICE}/ai{i}" for i in range(N_CHANNELS["ai"])),
        0x231F: ", ".join(f"{DEVICE}/ao{i}" for i in range(N_CHANNELS["ao"])),
    },
    "GetDeviceAttributeBool": {0x22CA: True},
    "GetDeviceAttributeUInt32": {0x0632: 0x0300B},
    "GetDeviceAttributeDouble": {0x298C: SAMPLE_RATE_HZ, 0x298D: SAMPLE_RATE_HZ, 0x2997: SAMPLE_RATE_HZ},
}
