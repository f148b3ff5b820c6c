"""Opening a bench: companion, guard, arm, the devices beside it; and closing them all."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from analysis.recordings.trial import Calibration
from rig.engine.bench import Bench
from rig.hardware.balance import Balance
from rig.hardware.clock import Clock, RemoteClock, SystemClock
from rig.hardware.companion import Companion
from rig.hardware.daq import Card
from rig.hardware.guard import Guard
from rig.hardware.lever import Lever
from rig.hardware.occupancy import RigLock
from rig.hardware.operator import RemoteOperator
from rig.hardware.remote import ControlService
from rig.hardware.stage import Stage
from rig.settings.rig_file import RigFile, ServiceSettings

_LONGEST_READ_S = 0.05
"""Half of the 100 ms within which a stop is to be met, where a rig file lets the card be read that seldom."""


@contextmanager
def _lasting_objects_set_aside() -> Iterator[None]:
    """Let collections of garbage pass over all that is loaded by now.

    Else each full one takes 50 ms and more, in which no sample is read, written or decided upon.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


@contextmanager
def open_bench(rig: RigFile, calibration: Calibration) -> Iterator[Bench]:
    """Open everything that a rig file names; on the way out the arm is at the safe position, all is closed.

    Raises RigError where something does not answer.
    """
    with ExitStack() as stack:
        companion = stack.enter_context(Companion(rig.companion)) if rig.companion else None

        def resolve(address: str) -> str:
            return address if companion is None else companion.resolve(address)

        def service(settings: ServiceSettings) -> ControlService:
            opened = ControlService(resolve(settings.address))
            stack.callback(opened.close)
            return opened

        card_address = resolve(rig.card.address)
        lock = stack.enter_context(RigLock(card_address, rig.card.device))
        with Card(card_address, rig.card.device, tls=rig.card.tls) as card:
            # the lock is this run's: tasks of this name are those of a dead one
            card.clear_left_over_tasks()
        clock: Clock = RemoteClock(service(rig.clock)) if rig.clock else SystemClock()
        hands = RemoteOperator(service(rig.operator)) if rig.operator else None
        stage = balance = None
        if rig.stage is not None:
            stage = stack.enter_context(Stage(rig.stage, resolve(rig.stage.port), clock))
        if rig.balance is not None:
            balance = stack.enter_context(Balance(rig.balance, resolve(rig.balance.port)))
        guard = None
        if rig.guard.enabled:
            held = [*lock.fds] + ([companion.stdin_fd] if companion is not None else [])
            guard = stack.enter_context(Guard(rig, card_address, calibration, held))
            lock.note(guard.pids)
        lever = stack.enter_context(Lever(rig, card_address, calibration, guard))
        stack.enter_context(_lasting_objects_set_aside())
        yield Bench(
            lever=lever,
            clock=clock,
            operator=hands,
            stage=stage,
            balance=balance,
            source="simulated" if rig.companion is not None else "nidaqmx",
            read_s=min(_LONGEST_READ_S, 2 * rig.card.read_interval_s),
            rig=rig.name,
            guards=() if guard is None else guard.pids,
        )
