"""The report's sentences, for a person at the bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.levels import FEW_TRIALS, FEWEST_HELD_OUT
from analysis.mismatch.locate.absorbed import Absorbed
from analysis.mismatch.locate.position_channel import PositionFinding
from analysis.mismatch.model.words import listed, spoken
from analysis.mismatch.name.lines import Line
from analysis.mismatch.name.own_sizes import Quantity
from analysis.mismatch.propose.proposal import NextExperiment
from analysis.mismatch.report import amounts
from analysis.mismatch.report.contents import NotIdentifiable, Report, Window
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Mechanism, library

TISSUE_WORDS = {
    "k0_mn_per_mm": "k0",
    "k1_mn_per_mm": "k1",
    "tau1_s": "tau1",
    "k2_mn_per_mm": "k2",
    "tau2_s": "tau2",
}
WORTH_SAYING = 0.01
SHOWS = 1e-6
"""Share of the stiffest constant below which one is only an optimum's way of saying nought."""


def explanation(mechanism: Mechanism, found: Mapping[str, Quantity], alternatives: Sequence[str]) -> str:
    """Say what a mechanism is and how large it was found."""
    text = mechanism.words[:1].upper() + mechanism.words[1:]
    if found:
        text += ": " + listed(
            [f"{amounts.symbol(name)} {amounts.with_error(q)}" for name, q in found.items()]
        )
    text += "."
    if alternatives:
        names = listed([spoken(n) for n in alternatives], "or")
        text += f" These trials can't tell it from {names}; {separated_by(mechanism)} would."
    return text


def separated_by(mechanism: Mechanism) -> str:
    """Say which run tells a mechanism from others."""
    words = spoken(mechanism.separated_by)
    article = {
        "rigid target": "a run on a rigid target",
        "air sweep": "an air sweep",
        "smaller depth": "a smaller depth",
    }
    return article.get(words, words)


def hidden(absorbed: Absorbed) -> str:
    """Say what a mechanism that can't be seen would do to the tissue's parameters."""
    m = absorbed.mechanism
    p = m.parameter(m.amplitude)
    size = f"{absorbed.values[m.amplitude]:g} {'' if p.unit == '1' else p.unit}".strip()
    shifts = sorted(absorbed.shift_percent.items(), key=lambda item: -abs(item[1]))
    told = [_shift(name, percent) for name, percent in shifts[:2] if abs(percent) > 100 * WORTH_SAYING]
    what = f"{amounts.symbol(m.amplitude)} of {size}"
    if not told:
        return f"{what} leaves no trace in these trials, and hardly touches the tissue's parameters"
    return f"the fitted tissue takes its place: {what} would hide here and make {listed(told)}"


def _shift(name: str, percent_linear: float) -> str:
    change = float(np.expm1(np.clip(percent_linear / 100.0, -3.0, 3.0)))
    word = (
        ("stiffer" if change > 0 else "softer")
        if name.startswith("k")
        else "longer"
        if change > 0
        else "shorter"
    )
    return f"{TISSUE_WORDS.get(name, name)} look {amounts.change_in_percent(abs(change)).lstrip('+')} {word}"


def place(window: Window) -> str:
    """Say where and how large a window is."""
    when = f"in the {window.phase} ({window.start_s:.3g} to {window.stop_s:.3g} s)"
    if 0.0 in (window.mean_residual_mn, window.mean_residual_um):
        # what has no mean at any one place is said in words: single samples, a line, a trend over the trials
        return f"{when}{', in the position' if window.signal == 'position' else ''}: {window.conditions}"
    if window.signal == "position":
        return f"{when}, the position is off by {window.mean_residual_um or 0.0:+.2g} um"
    if window.mean_residual_mn is not None and abs(window.mean_residual_mn) > 0.5 * (window.rms_mn or 0.0):
        return f"{when}, by {amounts.force(window.mean_residual_mn, signed=True)} on average"
    return f"{when}, by {amounts.force(window.rms_mn or 0.0)} rms"


def constants_told(constants: Mapping[str, Quantity]) -> set[str]:
    """Return the tissue's constants that the trials show: arms as stiff as matters, errors below the value."""
    stiffest = max((q.value for name, q in constants.items() if name.startswith("k")), default=0.0)
    shown = {
        name: q.value > SHOWS * stiffest and q.se < q.value for name, q in constants.items() if name[0] == "k"
    }
    for tau, k in (("tau1_s", "k1_mn_per_mm"), ("tau2_s", "k2_mn_per_mm")):
        if tau in constants:
            shown[tau] = shown.get(k, False) and constants[tau].se < constants[tau].value
    return {name for name, is_shown in shown.items() if is_shown}


def bias_words(report: Report, least: float = 0.01) -> str:
    """Say what the mismatch had done to the tissue's parameters, the largest two."""
    moved = []
    told = constants_told(report.baseline_parameters) & constants_told(report.improved_parameters)
    for name, spoken_name in TISSUE_WORDS.items():
        if name not in told:
            continue
        before, after = report.baseline_parameters[name], report.improved_parameters[name]
        change = before.value / after.value - 1.0
        if abs(change) > least and abs(before.value - after.value) > 3.0 * max(after.se, 1e-12):
            moved.append((abs(change), f"{spoken_name} by {amounts.change_in_percent(change)}"))
    moved.sort(reverse=True)
    return listed([text for _, text in moved[:3]])


def summary(report: Report, nameless: str) -> str:
    """Return one to three sentences: what differs, what was left out, how sure, what it did, what next.

    ``nameless`` are the words for what explains it and has no name in the library, where there are any.
    """
    said = [_headline(report, nameless)]
    if report.verdict != "no_mismatch" and report.mechanisms:
        bias = bias_words(report)
        if bias:
            said.append(f"Left out, it had shifted the tissue's {bias}.")
    if report.n_trials < FEW_TRIALS:
        said.append(
            f"Only {report.n_trials} trial{'s were' if report.n_trials > 1 else ' was'} given: how sure all this is "
            "rests on their noise as it was measured at rest, and "
            + (
                "nothing could be held out"
                if report.n_trials < FEWEST_HELD_OUT
                else "little could be held out"
            )
            + ", so slow noise may pass for an effect, or a slow effect for noise; record at least 8."
        )
    if report.verdict == "no_mismatch" and report.not_identifiable:
        said.append(_hidden_words(report.not_identifiable))
    if report.next_experiment is not None:
        said.append(
            f"Next: run next.toml ({report.next_experiment.adds}), which is predicted to "
            f"{_what_it_separates(report.next_experiment)}."
        )
    return " ".join(said)


def _what_it_separates(experiment: NextExperiment) -> str:
    """Say what the next run is for: telling rivals apart, or showing what could hide in the fitted tissue."""
    hiding = [spoken(a) for a, b in experiment.separates if b == "tissue"]
    rivals = [f"{spoken(a)} from {spoken(b)}" for a, b in experiment.separates if b != "tissue"]
    ways = []
    if rivals:
        ways.append(f"tell {listed(rivals)}")
    if hiding:
        ways.append(
            f"show whether {listed(hiding, 'or')} {'hides' if len(hiding) == 1 else 'hide'} in the tissue"
        )
    return listed(ways)


def _headline(report: Report, nameless: str) -> str:
    heldout = report.heldout
    if report.verdict == "no_mismatch":
        return (
            f"The simulation explains {_trials(report)} to the noise ({amounts.force(heldout.noise_floor_mn)} rms a "
            "sample): nothing is missing that these recordings could show."
        )
    if report.verdict == "unknown":
        if not report.mechanisms:
            where = f" {place(report.mismatch[0])}" if report.mismatch else ""
            words = f": {nameless}" if nameless else ""
            return f"Simulation and recordings differ{where}, and no mechanism of the library explains it{words}."
        names = listed([f"{spoken(m.name)}{_size(m.parameters)}" for m in report.mechanisms])
        where = f" {place(report.mismatch[0])}" if report.mismatch else ""
        explains = "explains" if len(report.mechanisms) == 1 else "explain"
        share = f" and {explains} {amounts.percent(report.explained_share)}"
        found = f"{_capital(names)} {_was(report)} found{share} of what differed"
        return f"{found}. What is left no mechanism of the library explains: it is largest{where}."
    names = listed([f"{spoken(m.name)}{_size(m.parameters)}" for m in report.mechanisms])
    before, after, noise = amounts.errors(heldout)
    sure = (
        f"the error{' on trials that were not fitted' if report.n_trials >= FEWEST_HELD_OUT else ''} falls from "
        f"{before} to {after} rms (noise {noise}; p {p_words(report)})"
    )
    if [m.stage for m in report.mechanisms] == ["lever"] and report.mechanisms[0].name == "servo_bandwidth":
        sure = (
            f"it shows in the recorded position (p {p_words(report)}), and the force given that position is "
            "explained"
        )
    if report.verdict == "named":
        return f"The simulation left out {names}: {sure}."
    rivals = sorted({spoken(a) for m in report.mechanisms for a in m.alternatives})
    return (
        f"The simulation left out {names}, or what looks the same in these trials ({listed(rivals, 'or')}): "
        f"{sure}."
    )


def p_words(report: Report) -> str:
    """Return the largest p-value of all that was named, with its sign."""
    p = amounts.chance(max(m.p_value for m in report.mechanisms))
    return p if p.startswith("<") else f"= {p}"


def _trials(report: Report) -> str:
    return "the trial" if report.n_trials == 1 else f"all {report.n_trials} trials"


def _was(report: Report) -> str:
    return "was" if len(report.mechanisms) == 1 else "were"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _size(parameters: Mapping[str, Quantity]) -> str:
    for name, q in parameters.items():
        return f" ({amounts.symbol(name)} {amounts.with_error(q)})"
    return ""


def _hidden_words(absorbed: Sequence[NotIdentifiable]) -> str:
    names = listed([spoken(a.name) for a in absorbed[:3]])
    tissue = "could still hide in the fitted tissue"
    ways = listed(list(dict.fromkeys(separated_by(library()[a.name]) for a in absorbed[:3])), "or")
    return f"{_capital(names)} {tissue}; {ways} would show {'it' if len(absorbed) == 1 else 'them'}."


def louder(trials: Sequence[CellTrial]) -> list[str]:
    """Say by how much the noise grows with force, where it does."""
    ratios = [float(t.louder.max() / t.louder.min()) for t in trials if t.louder is not None]
    said = f"The noise grows with the force: it is up to {max(ratios, default=1.0):.2g} times what it is without."
    return [said] if ratios else []


def tones(lines: Sequence[Line], noise: NoiseModel) -> list[str]:
    """Say which tones the trials have, and what was done about them."""
    said = [
        f"A tone at {line.frequency_hz:.4g} Hz ({amounts.force(line.amplitude_mn)}) is in every trial; it was taken "
        "out before anything else was looked at."
        for line in lines
    ]
    return said + [
        f"The force sways at about {frequency_hz:.3g} Hz ({amounts.force(float(np.sqrt(variance)))} rms), in phase "
        f"with itself for {lasts_s:.2g} s, as on a building or a bench that does; it was weighed as noise."
        for variance, frequency_hz, lasts_s in noise.bands
    ]


def late(position: PositionFinding | None, rate_hz: float) -> tuple[str, ...]:
    """Return what a reader must know of a position that comes later than by the half sample of an output that steps."""
    late_s = position.late_s if position else 0.0
    if late_s * rate_hz <= 0.5:
        return ()
    return (
        f"The position comes {1e3 * late_s:.2g} ms later than the rig file's servo would have it: a delay of "
        f"{late_s * rate_hz:.1f} samples explains that no worse than another servo.",
    )
