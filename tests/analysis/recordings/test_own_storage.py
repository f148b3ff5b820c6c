"""Files from strangers: nothing beside them is ever read."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.recordings import read_trial, write_trial


def _replace(file, name, make):
    del file[name]
    make()


def _external_link(file, secret):
    _replace(
        file, "signals/force_v", lambda: file.__setitem__("signals/force_v", h5py.ExternalLink(secret, "x"))
    )


def _linked_group(file, secret):
    file["import"] = h5py.ExternalLink(secret, "/")


def _virtual(file, secret):
    layout = h5py.VirtualLayout(shape=(100,), dtype="f8")
    layout[:] = h5py.VirtualSource(secret, "x", shape=(100,))
    _replace(file, "signals/force_v", lambda: file.create_virtual_dataset("signals/force_v", layout))


def _external_storage(file, secret):
    _replace(
        file,
        "signals/force_v",
        lambda: file.create_dataset("signals/force_v", (100,), "f8", external=[(secret, 0, 800)]),
    )


def _unread(file, secret):
    file.create_dataset("notes/far/away", (100,), "f8", external=[(secret, 0, 800)])


@pytest.mark.parametrize("attack", [_external_link, _linked_group, _virtual, _external_storage, _unread])
def test_what_lies_in_another_file_is_not_followed(tmp_path, a_trial, attack):
    path, secret = tmp_path / "t.h5", tmp_path / "secret.h5"
    write_trial(path, a_trial())
    with h5py.File(secret, "w") as file:
        file["x"] = np.full(100, 42.0)
    with h5py.File(path, "r+") as file:
        attack(file, str(secret))
    with pytest.raises(
        BadInputError, match=r"is a link to another file|keeps its data in another file"
    ) as caught:
        read_trial(path)
    assert "\n" not in str(caught.value)


def test_a_ring_of_groups_ends(tmp_path, a_trial):
    path = tmp_path / "t.h5"
    write_trial(path, a_trial())
    with h5py.File(path, "r+") as file:
        file["signals/again"] = file["/"]
        file["nowhere"] = h5py.SoftLink("/not/there")
    assert read_trial(path).n_samples > 0
