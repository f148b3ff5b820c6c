"""The line to a card in another computer: proven on both sides, or said to be open."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from analysis.errors import BadInputError
from rig.hardware.daq import Card
from rig.hardware.errors import CardMissingError
from rig.settings.reading import load_rig, parse_rig
from rig.settings.rig_file import TlsSettings

TLS = '[card.tls]\nauthority = "a.pem"\ncertificate = "c.pem"\nkey = "c.key"\n'


def openssl(folder: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True)


def authority(folder: Path, name: str) -> None:
    subject = ["-subj", f"/CN={name}", "-days", "2"]
    openssl(
        folder,
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-keyout",
        f"{name}.key",
        "-out",
        f"{name}.pem",
        *subject,
    )


def signed(folder: Path, name: str, by: str) -> None:
    (folder / "names").write_text("subjectAltName=IP:127.0.0.1,DNS:localhost")
    openssl(
        folder,
        "req",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-keyout",
        f"{name}.key",
        "-out",
        f"{name}.csr",
        "-subj",
        f"/CN={name}",
    )
    signing = [
        "-CA",
        f"{by}.pem",
        "-CAkey",
        f"{by}.key",
        "-CAcreateserial",
        "-days",
        "2",
        "-extfile",
        "names",
    ]
    openssl(folder, "x509", "-req", "-in", f"{name}.csr", "-out", f"{name}.pem", *signing)


def test_only_a_proven_client_reaches_the_card(bench_of: Callable[..., Any], tmp_path: Path) -> None:
    for name in ("lab", "stranger"):
        authority(tmp_path, name)
    signed(tmp_path, "server", "lab")
    signed(tmp_path, "client", "lab")
    signed(tmp_path, "other", "stranger")
    server = {
        key: str(tmp_path / name)
        for key, name in (("authority", "lab.pem"), ("certificate", "server.pem"), ("key", "server.key"))
    }
    tls = "[companion.settings.tls]\n" + "".join(f'{key} = "{file}"\n' for key, file in server.items())

    def client(name: str, by: str = "lab") -> TlsSettings:
        return TlsSettings(
            authority=str(tmp_path / f"{by}.pem"),
            certificate=str(tmp_path / f"{name}.pem"),
            key=str(tmp_path / f"{name}.key"),
        )

    with bench_of(more=tls) as bench:
        with Card(bench.card_address, "Dev1", tls=client("client")) as card:
            card.connect()
        for stranger in (None, client("other"), client("client", by="stranger")):
            with Card(bench.card_address, "Dev1", tls=stranger) as card, pytest.raises(CardMissingError):
                card.connect()
    with pytest.raises(CardMissingError, match=r"card\.tls"):
        Card("127.0.0.1:1", "Dev1", tls=client("nobody"))


def test_a_card_elsewhere_needs_certificates_or_a_plain_word() -> None:
    far = '[card]\naddress = "192.168.0.7:31763"\n'
    with pytest.raises(BadInputError, match=r"is another computer: say in \[card.tls\]"):
        parse_rig(far, "rig.toml")
    assert parse_rig(far + "open_line = true\n", "rig.toml").card.open_line
    assert parse_rig(far + TLS, "rig.toml").card.tls is not None
    with pytest.raises(BadInputError, match="the line is either"):
        parse_rig(far + "open_line = true\n" + TLS, "rig.toml")
    for near in ("127.0.0.1:31763", "localhost:31763"):
        assert parse_rig(f'[card]\naddress = "{near}"\n', "rig.toml").card.tls is None


def test_certificates_lie_beside_the_rig_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('[card]\naddress = "daq-pc:31763"\n' + TLS)
    tls = load_rig(path).card.tls
    assert tls is not None
    assert tls.key == str(tmp_path / "c.key")
