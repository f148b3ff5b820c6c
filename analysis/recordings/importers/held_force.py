"""A pause in which force is held and position creeps: it is no relaxation, and is not to be taken for one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.recordings.importers.draft import Draft
from analysis.recordings.trial import Event

_SETTLED = 0.05  # of a pause, in which the controller settles
_HELD = 0.03  # of the peak, by which a held force may change in a pause
_FEWEST = 8


def without_held_force(draft: Draft) -> Draft:
    """Return the draft; where force stands in its hold and position moves more, there is a creep and no hold.

    The event ``force_held`` then says so; its sample is where the pause begins.
    """
    hold = next((phase for phase in draft.phases if phase.name == "hold"), None)
    ramp = next((phase for phase in draft.phases if phase.name == "ramp"), None)
    if hold is None or ramp is None:
        return draft
    first = hold.start + int(_SETTLED * (hold.stop - hold.start))
    if hold.stop - first < 4 * _FEWEST:
        return draft
    c = draft.calibration
    position_mm = (draft.position_v - c.position_zero_v) / c.volts_per_mm
    force_mn = (draft.force_v - c.force_zero_v) / c.volts_per_mn
    level_mn = float(np.median(force_mn[first : hold.stop]))
    before_mn = float(np.median(force_mn[max(0, ramp.start - 20) : ramp.start + 1]))
    travel_mm = float(position_mm[hold.start] - position_mm[ramp.start])
    parts = np.array_split(np.arange(first, hold.stop), 20)
    forces = np.array([force_mn[part].mean() for part in parts])
    places = np.array([position_mm[part].mean() for part in parts])
    fell = float(np.ptp(forces)) / max(abs(level_mn - before_mn), 1e-300)
    crept_mm = float(places[-1] - places[0])
    steady = np.all(np.diff(places) > -0.1 * abs(crept_mm)) and crept_mm > 0
    if not (fell < _HELD and steady and crept_mm > 2.0 * fell * abs(travel_mm)):
        return draft
    noise_mm = float(np.std(np.diff(position_mm[first : hold.stop]))) / np.sqrt(len(parts[0]))
    if crept_mm < 6.0 * noise_mm or crept_mm < 0.005 * abs(travel_mm):
        return draft
    seconds = (hold.stop - hold.start) / draft.sample_rate_hz
    words = f"force held at {level_mn:.4g} mN for {seconds:.4g} s, position creeps {crept_mm:.3g} mm"
    kept = tuple(phase for phase in draft.phases if phase is not hold)
    return replace(
        draft,
        phases=kept,
        events=(*draft.events, Event(hold.start, "force_held", words)),
        protocol=replace(draft.protocol, hold_s=None),
        log=(*draft.log, f"{words}: a creep, there is no hold"),
    )
