"""Ask the system to let this process run soon after it wakes, although others keep the processors busy."""

import ctypes
import os
import platform
import struct

_SCHED_SETATTR = {"x86_64": 314, "aarch64": 274}
_SLICE_NS = 100_000


def ask_for_short_slices() -> bool:
    """Ask Linux for turns of 0.1 ms, more often, for this thread and those it starts; whether it agreed.

    Kernels from 6.12 let any process trade the length of its turns for their promptness (`sched_setattr` with
    a runtime under the ordinary policy; see sched(7)). Older kernels and other systems go on as they were.
    """
    number = _SCHED_SETATTR.get(platform.machine())
    if platform.system() != "Linux" or number is None:
        return False
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    # struct sched_attr: size, policy (0: ordinary), flags, nice, priority, runtime, deadline, period
    attributes = ctypes.create_string_buffer(struct.pack("=IIQiIQQQ", 48, 0, 0, nice, 0, _SLICE_NS, 0, 0), 48)
    return bool(ctypes.CDLL(None, use_errno=True).syscall(number, 0, attributes, 0) == 0)
