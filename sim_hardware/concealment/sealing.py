"""Seals: a salted digest that commits to a truth without telling it."""

from __future__ import annotations

import hashlib
import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Sealed:
    """A truth as text, its salt, and the seal: SHA-256 over the salt and the text, in hexadecimal."""

    text: str
    salt: str
    seal: str


def seal(truth: Mapping[str, object]) -> Sealed:
    """Seal a truth with a fresh salt of 32 bytes."""
    text = json.dumps(truth, sort_keys=True, separators=(",", ":"))
    salt = secrets.token_hex(32)
    return Sealed(text, salt, digest(salt, text))


def digest(salt: str, text: str) -> str:
    """Return the seal of a text under a salt."""
    return hashlib.sha256(f"{salt}\n{text}".encode()).hexdigest()
