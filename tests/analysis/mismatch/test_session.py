"""What follows the order of the trials: rarely found where nothing does, and found where skin soaks."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.locate.session import find_trend
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import study_plans

SCATTER = 0.1
STUDIES, LEVEL = 400, 0.05


@pytest.fixture(scope="module")
def fitted(record: Callable[..., list[Trial]]) -> StudyFit:
    """Sixteen trials on two fingers, fitted."""
    trials = record(31, plans=study_plans(depths_mm=(0.3, 0.7), repeats=8, hold_s=1.0, dwell_s=0.3))
    cells = take_in_memory(trials).trials
    order = np.random.default_rng(5).permutation(len(cells))
    fingers = [
        replace(c, order=int(k), finger="ring" if k % 3 else "index")
        for c, k in zip(cells, order, strict=True)
    ]
    return fit_baseline(fingers)


def with_tissues(fit: StudyFit, seed: int, drift: float = 0.0) -> StudyFit:
    """Return the fit with tissues that scatter as sites do, tau2 growing with the order of the trials."""
    random = np.random.default_rng(seed)
    states = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        tissue = fit.population.mean + random.normal(0.0, SCATTER, 5)
        tissue[4] += drift * (1.0 - np.exp(-trial.order / 4.0)) + (0.2 if trial.finger == "ring" else 0.0)
        states.append(replace(state, log_tissue=tissue))
    return replace(fit, states=tuple(states))


def test_the_order_of_trials_says_nothing_where_sites_only_scatter(fitted: StudyFit) -> None:
    evidence = np.array([find_trend(with_tissues(fitted, seed)).evidence for seed in range(STUDIES)])
    # -ln p exceeds -ln 0.05 in no more than a twentieth: 20 of 400, and 46 six standard deviations above
    assert int((evidence > -np.log(LEVEL)).sum()) < 46
    # the test has a size: of two courses that are much alike, the better one's p counts twice
    assert int((evidence > -np.log(LEVEL)).sum()) > 2


def test_skin_that_soaks_is_found_and_said(fitted: StudyFit) -> None:
    trend = find_trend(with_tissues(fitted, 1, drift=1.6))
    assert trend.significant
    assert trend.change[4] == pytest.approx(1.6, abs=0.5)
    assert "tau2 by +" in trend.words
    assert trend.rms_mn > 0.0
    assert 0.0 < trend.start_s < trend.stop_s


def test_of_few_trials_or_where_every_finger_was_pressed_once_nothing_is_said(fitted: StudyFit) -> None:
    soaked = with_tissues(fitted, 1, drift=1.6)
    few = replace(soaked, trials=soaked.trials[:8], states=soaked.states[:8], whiteners=soaked.whiteners[:8])
    assert not find_trend(few).significant
    in_air = tuple(replace(s, log_tissue=np.zeros(0)) for s in soaked.states)
    assert not find_trend(replace(soaked, states=in_air)).significant
    each_another = tuple(replace(t, finger=str(j)) for j, t in enumerate(soaked.trials))
    assert not find_trend(replace(soaked, trials=each_another)).significant


REPEATS = 3


def at_sites(fit: StudyFit, seed: int, softens: float = 0.0) -> StudyFit:
    """Return the fit with sites that scatter, each pressed three times: repeats differ little, or ever softer ones."""
    random = np.random.default_rng(seed)
    trials, states = [], []
    for k, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True)):
        site, repeat = divmod(k, REPEATS)
        of_site = np.random.default_rng([seed, site]).normal(0.0, SCATTER, 5)
        tissue = fit.population.mean + of_site + random.normal(0.0, 0.1 * SCATTER, 5)
        tissue[0] -= softens * np.log1p(repeat)
        trials.append(replace(trial, order=k, site=str(site), depth_mm=0.3 + 0.1 * (site % 3)))
        states.append(replace(state, log_tissue=tissue))
    return replace(fit, trials=tuple(trials), states=tuple(states))


def test_a_site_pressed_again_is_no_other_site(fitted: StudyFit) -> None:
    """Sites pressed in turn, three times each, were a trend over the session in two studies of six."""
    found = [find_trend(at_sites(fitted, seed)) for seed in range(STUDIES)]
    evidence = np.array([trend.evidence for trend in found])
    # as above: 20 of 400, and 46 six standard deviations above
    assert int((evidence > -np.log(LEVEL)).sum()) < 46


def test_skin_that_softens_with_every_repeat_is_found_and_said(fitted: StudyFit) -> None:
    trend = find_trend(at_sites(fitted, 1, softens=0.1))
    assert trend.significant
    assert trend.of_repeats
    assert trend.change[0] == pytest.approx(-0.1 * np.log(3.0), abs=0.03)
    assert trend.words.startswith("a trend over the repeats at one site, from first repeat to last: k0 by -1")
