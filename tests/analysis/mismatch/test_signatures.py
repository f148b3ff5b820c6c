"""What a law would look like in the residual: its own work, whatever else the simulation holds."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.mismatch.intake import take_in_memory
from analysis.mismatch.noise import NoiseModel
from analysis.mismatch.shared import Addition, Hum, Simulation
from analysis.mismatch.signatures import Probe, probe_columns
from analysis.mismatch.start import start_own, start_tissue
from analysis.mismatch.weighing import weighed
from analysis.simulation.mechanism import library

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import study_plans


def test_hum_that_was_named_is_no_part_of_a_laws_signature() -> None:
    plans = study_plans(depths_mm=(0.3,), repeats=2)
    trials = take_in_memory(bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)).trials
    plain = weighed(trials, NoiseModel(0.3)).fit(
        Simulation(start_tissue(trials)), start_own(trials), rounds=1
    )
    hum = Hum(50.0, {t.label: (0.3, 0.4) for t in trials})
    heard = replace(plain.simulation, additions=(Addition(library()["mains_hum"], {}, hum=hum),))
    probes = [Probe(m, {**m.null, **m.typical}) for m in library().values() if m.form == "law" and m.typical]
    alone, beside = (
        probe_columns(trials[0], fit, 0, probes) for fit in (plain, replace(plain, simulation=heard))
    )
    assert np.linalg.norm(alone) > 1.0
    np.testing.assert_allclose(beside, alone, atol=1e-9)
