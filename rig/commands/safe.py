"""Takes the card of a run that died and brings the arm to the safe position: `indenter safe`."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from analysis.errors import BadInputError
from rig.calibration.kept import calibration_folder, newest_calibration
from rig.commands.run import load_rig_or_simulated
from rig.hardware.companion import Companion
from rig.hardware.daq import Card
from rig.hardware.occupancy import RigLock
from rig.hardware.retreat import Retreat, bring_to_safety


def make_safe(rig: Path | None) -> Retreat:
    """Bring the arm of a rig to the safe position; what was found and done.

    Guards of a dead run that do not come to an end are ended, and the tasks it left on the card's server are
    cleared. Raises RigBusyError where a run goes on, RetreatFailedError or CardError where the arm can't be moved.
    """
    settings = load_rig_or_simulated(rig)
    nominal = settings.calibration.nominal()
    try:
        calibration, _ = newest_calibration(settings, calibration_folder(settings, rig))
    except BadInputError:
        calibration = nominal  # the arm must not wait until a calibration file is mended
    with ExitStack() as stack:
        address = settings.card.address
        if settings.companion is not None:
            address = stack.enter_context(Companion(settings.companion)).resolve(address)
        stack.enter_context(RigLock(address, settings.card.device, end_guards=True))
        card = stack.enter_context(Card(address, settings.card.device, tls=settings.card.tls))
        return bring_to_safety(card, settings.card, settings.lever, calibration)
