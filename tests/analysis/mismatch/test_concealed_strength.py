"""The bench says how strong an effect is; the analysis, which knows nothing of the bench, must agree."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from sim_hardware.concealment.plans import study_plans
from sim_hardware.concealment.strength import strength

SHORT = tuple(study_plans(depths_mm=(0.4, 0.7), repeats=2, hold_s=2.0, dwell_s=0.5))


@pytest.fixture(scope="module")
def detection() -> ModuleType:
    path = Path(__file__).parents[2] / "benchmarks" / "detection.py"
    spec = spec_from_file_location("detection", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their own module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    "name", ["adhesion", "viscous_friction", "third_relaxation", "stiffening", "force_drift"]
)
def test_bench_and_analysis_agree_on_strength(detection: ModuleType, name: str) -> None:
    """To 10 %: the analysis averages over cells and smooths the motion, the bench projects every sample."""
    study = detection.study_with(name, seed=6, plans=SHORT)
    assert strength(study.bench, [study.effect], SHORT) == pytest.approx(study.strength, rel=0.1)
