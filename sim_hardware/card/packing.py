"""Samples as the wire carries them, without a Python object for each."""

from typing import Any

import numpy as np
from nidaqmx._stubs import nidaqmx_pb2

from sim_hardware.card.plant import FloatArray

_READ_ARRAY_TAG = bytes([nidaqmx_pb2.ReadAnalogF64Response.READ_ARRAY_FIELD_NUMBER << 3 | 2])


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def packed_samples(samples: FloatArray, size: int, *, n_read: int, status: int) -> Any:
    """A ReadAnalogF64Response with `samples` in their order, filled up with zeros to `size` numbers.

    A `repeated double` is its tag, its length in bytes and the numbers, little-endian, one after the other
    (protocol buffers, encoding of packed fields), so that the array is copied rather than built up.
    """
    values = np.zeros(max(size, samples.size), dtype="<f8")
    values[: samples.size] = samples.ravel()
    data = values.tobytes()
    response = nidaqmx_pb2.ReadAnalogF64Response.FromString(_READ_ARRAY_TAG + _varint(len(data)) + data)
    response.samps_per_chan_read = n_read
    response.status = status
    return response
