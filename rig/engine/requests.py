"""What another process may ask of a run, as messages: parsed strictly, bounded in size, only with the run's token."""

from __future__ import annotations

import hmac
import uuid
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

MAX_BYTES = 8192
"""A longer message is no request; its sender is disconnected."""

Text = Annotated[str, Field(max_length=1024)]
Id = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9_\-]+$")]


class _Request(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)
    id: Id


class Stop(_Request):
    """End the run: the arm is taken clear, the trial under way is kept as aborted."""

    do: Literal["stop"]


class Retreat(_Request):
    """End the trial under way, take the arm clear, and pause."""

    do: Literal["retreat"]


class Pause(_Request):
    """Go on no further than the end of the trial under way."""

    do: Literal["pause"]


class GoOn(_Request):
    """End a pause, or the wish for one."""

    do: Literal["go_on"]


class Skip(_Request):
    """Leave out the rest under way, or the trial that is being prepared."""

    do: Literal["skip"]
    what: Literal["rest", "trial"]


class Repeat(_Request):
    """Record a trial of the plan again, next, at a new site."""

    do: Literal["repeat"]
    trial: Text


class Discard(_Request):
    """Mark a trial as no good, by the name of its file; the file stays."""

    do: Literal["discard"]
    file: Text
    reason: Annotated[str, Field(min_length=1, max_length=1024, pattern=r"\S")]


class Restore(_Request):
    """Take back that a trial was discarded."""

    do: Literal["restore"]
    file: Text


class Answer(_Request):
    """Answer a prompt: what was asked for is done, it can't be done, or a number that was read off."""

    do: Literal["answer"]
    prompt: Id
    answer: Literal["done", "cancel"]
    value: float | None = None


class Run(_Request):
    """Run a protocol, or go on with it where `out` holds its beginning.

    `accept`: also where those trials were recorded with another calibration; else that is asked first.
    """

    do: Literal["run"]
    protocol: Text
    out: Text
    hands: Literal["person", "bench"] = "person"
    accept: bool = False


class Calibrate(_Request):
    """Run a calibration; its result waits to be accepted."""

    do: Literal["calibrate"]
    which: Literal["position", "force"]
    hands: Literal["person", "bench"] = "person"


class Accept(_Request):
    """Keep the calibration just measured, so that later runs take it; or leave it."""

    do: Literal["accept"]
    keep: bool


class Close(_Request):
    """Close the bench, where nothing runs."""

    do: Literal["close"]


Request = Annotated[
    Stop
    | Retreat
    | Pause
    | GoOn
    | Skip
    | Repeat
    | Discard
    | Restore
    | Answer
    | Run
    | Calibrate
    | Accept
    | Close,
    Field(discriminator="do"),
]
_REQUEST: TypeAdapter[Request] = TypeAdapter(Request)

_LONGEST_WHY = 300


class _Envelope(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)
    token: Annotated[str, Field(max_length=128)]
    request: Annotated[str, Field(max_length=MAX_BYTES)]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a request: taken on, or refused and why."""

    id: str
    accepted: bool
    why: str = ""


def make_request(do: str, **more: object) -> Request:
    """Return a request with an id of its own. Raises ValueError where it is none."""
    return _REQUEST.validate_python({"id": uuid.uuid4().hex[:16], "do": do, **more})


def sealed(request: Request, token: str) -> bytes:
    """Return the message that carries a request."""
    return _Envelope(token=token, request=request.model_dump_json()).model_dump_json().encode()


def parse_request(message: bytes, token: str) -> Request | Verdict | None:
    """Return the request of a message; its refusal where it is malformed; None where it is a stranger's.

    Never raises, whatever the message.
    """
    if len(message) > MAX_BYTES:
        return None
    try:
        envelope = _Envelope.model_validate_json(message)
        if not hmac.compare_digest(envelope.token.encode(), token.encode()):
            return None
    except (ValidationError, UnicodeError):
        return None
    try:
        return _REQUEST.validate_json(envelope.request)
    except (ValidationError, UnicodeError) as error:
        first = error.errors()[0] if isinstance(error, ValidationError) else {"loc": (), "msg": "no text"}
        where = ".".join(str(part) for part in first["loc"]) or "the request"
        # what was sent comes back in it: one line of that is enough for all who follow the run
        why = " ".join(f"{where}: {first['msg']}".split())[:_LONGEST_WHY]
        return Verdict(_id_of(envelope.request), accepted=False, why=why)


class _OnlyId(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)
    id: Id


def _id_of(request: str) -> str:
    try:
        return _OnlyId.model_validate_json(request).id
    except (ValidationError, UnicodeError):
        return "unknown"
