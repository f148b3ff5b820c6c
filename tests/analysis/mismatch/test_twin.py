from __future__ import annotations

import tomllib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import tomlkit

from analysis.mismatch.fit.noise import Band, NoiseModel
from analysis.mismatch.fit.own import force_columns, own_columns
from analysis.mismatch.fit.trial_fit import fit_trial
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.model.effects import Law, Shared, TrialState, simulate
from analysis.mismatch.model.population import Population
from analysis.mismatch.report.twin import STEP_ONLY, bench_effect, noise_settings
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import library
from rig.settings.reading import parse_rig
from sim_hardware.concealment.offline import study_plans
from sim_hardware.settings import BenchSettings, EffectSettings


@pytest.mark.parametrize("study", ["clinging", "plain"])
def test_twin_is_a_rig_file_whose_bench_accepts_its_settings(
    study: str, request: pytest.FixtureRequest
) -> None:
    text = (request.getfixturevalue(study).out / "twin.toml").read_text(encoding="utf-8")
    rig = parse_rig(text, "twin.toml")
    assert rig.companion is not None
    assert rig.card.address == "companion:card"
    bench = BenchSettings.from_toml(tomlkit.dumps(tomllib.loads(text)["companion"]["settings"]))
    assert not bench.specimens.published_tissue
    assert bench.specimens.site_variation < 0.03
    assert bench.tissue.k0_mn_per_mm == pytest.approx(120.0, rel=0.02)
    assert bench.noise.force_mn_rms == pytest.approx(0.3, rel=0.05)
    assert bench.noise.position_um_rms == pytest.approx(0.25, rel=0.05)


@pytest.mark.parametrize("name", sorted(set(library()) - {STEP_ONLY}))
def test_the_bench_takes_every_mechanism_of_the_library(name: str) -> None:
    mechanism = library()[name]
    probes = mechanism.probe_settings(80.0, 0.8) or ({},)
    typical = {**mechanism.null, **mechanism.typical, **probes[0]}
    named = {p.name: typical[p.name] for p in mechanism.parameters if p.name in typical and not p.inner}
    effect = EffectSettings.model_validate(bench_effect(name, named, 0.8))
    assert effect.name == name


def test_twin_behaves_as_the_found_simulation(
    clinging: Any, bench_trials: Callable[..., list[Trial]]
) -> None:
    settings = tomllib.loads((clinging.out / "twin.toml").read_text(encoding="utf-8"))["companion"][
        "settings"
    ]
    assert [e["name"] for e in settings["effects"]] == ["adhesion"]
    assert settings["effects"][0]["rough"] == 0.0
    trials = bench_trials(
        tomlkit.dumps(settings), study_plans(depths_mm=(0.4, 0.6), repeats=2, hold_s=2.0, dwell_s=0.4)
    )
    cells = take_in_memory(trials).trials
    names = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")
    mean = np.log([clinging.report["improved_parameters"][n]["value"] for n in names])
    adhesion = library()["adhesion"]
    found = clinging.report["mechanisms"][0]["parameters"]["pull_off_mn"]["value"]
    shared = Shared((Law(adhesion, {**adhesion.null, "pull_off_mn": found}, ("pull_off_mn",)),))
    noise = NoiseModel(clinging.report["heldout"]["noise_floor_mn"])
    left = []
    for trial in cells:
        whitener = Whitener(trial, noise)
        # the twin's sites scatter as those that were recorded do
        state = TrialState(mean, trial.z0_start_mm, trial.offset_start_mn)
        population = Population(mean, 0.03**2 * np.eye(5))
        own = own_columns(force_columns(trial, state, shared), whitener, state, population)
        fitted, _ = fit_trial(trial, whitener, state, shared, population, own)
        left.append(whitener(trial.force_mn - simulate(trial, fitted, shared)))
    # the cells about the snap are single samples, in which a rounder letting go shows
    assert np.std(np.concatenate(left)) == pytest.approx(1.0, rel=0.2)


def test_noise_of_the_twin_has_the_variance_of_the_model() -> None:
    model = NoiseModel(0.2, ((0.01, 0.002), (0.04, 0.4)))
    swaying = noise_settings(replace(model, bands=(Band(0.02, 20.0, 0.3),)), 3e-4)
    assert swaying["force_mn_rms"] ** 2 == pytest.approx(0.2**2 + 0.01 + 0.02)
    found = noise_settings(model, 3e-4)
    assert found["force_mn_rms"] ** 2 + found["wander_mn_rms"] ** 2 == pytest.approx(model.rms_mn**2)
    assert found["correlated_share"] == pytest.approx(0.01 / 0.05)
    assert found["correlation_ms"] == pytest.approx(2.0)
    assert found["wander_time_s"] == pytest.approx(0.4)
    assert found["position_um_rms"] == pytest.approx(0.3)
