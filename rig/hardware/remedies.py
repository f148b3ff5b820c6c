"""What a card's error means to this program, and what to do about it."""

from __future__ import annotations

import grpc

from rig.hardware.card_server import DEADLINE_S
from rig.hardware.errors import (
    CardBusyError,
    CardError,
    CardMissingError,
    OutputStarvedError,
    SamplesLateError,
    SamplesLostError,
)

Remedy = tuple[type[CardError], str]

_BY_CODE: dict[int, Remedy] = {
    -200279: (SamplesLostError, "the computer was too slow to read; close other programs, then run again"),
    -200361: (SamplesLostError, "the card's own memory overflowed; close other programs, then run again"),
    -200278: (SamplesLostError, "the acquisition had already ended; run again"),
    -200284: (SamplesLateError, "no samples came in time; check the card's cable and its sample clock"),
    -200290: (OutputStarvedError, "the output ran dry and stopped; close other programs, then run again"),
    -200621: (OutputStarvedError, "the output ran dry and stopped; close other programs, then run again"),
    -50103: (CardBusyError, "another program uses the card; end it, then run again"),
    -200089: (CardBusyError, "another run uses the card; end it, then run again"),
    -200022: (CardBusyError, "another program uses the card; end it, then run again"),
    -200220: (CardMissingError, "no card of that name; compare card.device in rig.toml with NI MAX"),
    -200170: (CardMissingError, "no such channel on this card; check the channels under [card] in rig.toml"),
    -201003: (CardMissingError, "the card is gone; check its cable and power, then run again"),
    -88710: (CardError, "another program ended the task (the guard, if this one was silent); run again"),
    -200088: (CardError, "another program ended the task (the guard, if this one was silent); run again"),
    -200452: (CardError, "this card does not have that property; use a card of the S Series"),
    -200561: (CardError, "a voltage beyond the output's range; check [calibration] in rig.toml"),
}

_BY_STATUS: dict[grpc.StatusCode, Remedy] = {
    grpc.StatusCode.UNAVAILABLE: (
        CardMissingError,
        "the card's server does not answer; start it and check card.address in rig.toml",
    ),
    grpc.StatusCode.DEADLINE_EXCEEDED: (
        CardMissingError,
        f"the card's server has not answered for {DEADLINE_S:g} s; restart it, then run again",
    ),
    grpc.StatusCode.ALREADY_EXISTS: (
        CardBusyError,
        "another run holds the card; end it (or restart the card's server), then run again",
    ),
    grpc.StatusCode.UNIMPLEMENTED: (CardError, "the card's server is too old for this call; upgrade it"),
    grpc.StatusCode.CANCELLED: (
        CardMissingError,
        "the card's server closed the connection; see that it runs, then run again",
    ),
}


def remedy_for_code(code: int) -> Remedy:
    """Return the error of this program and the remedy for an error code of NI-DAQmx."""
    return _BY_CODE.get(code, (CardError, "look the code up at ni.com, then run again"))


def remedy_for_server(status: grpc.StatusCode) -> Remedy:
    """Return the error of this program and the remedy for what befell a call to the card's server."""
    return _BY_STATUS.get(status, (CardError, "check the card's server, then run again"))
