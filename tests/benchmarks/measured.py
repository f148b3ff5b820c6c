"""A diagnosis as a user runs it, with what it took: the one road of every campaign to report.json."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import analysis

ROOT = Path(analysis.__file__).parents[1]
"""Where the code lies that is measured."""
Row = dict[str, Any]

_MEASURE = """
import json, resource, subprocess, sys, time
began = time.monotonic()
ended = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
wall_s = time.monotonic() - began
used = resource.getrusage(resource.RUSAGE_CHILDREN)
words = ended.stderr.strip().splitlines()
print(json.dumps({"wall_s": wall_s, "cpu_s": used.ru_utime + used.ru_stime, "peak_mb": used.ru_maxrss / 1024,
                  "error": (words or ["no reason given"])[-1] if ended.returncode else ""}))
"""


def diagnose(trials: Path, out: Path, seed: int = 0) -> Row:
    """Run `indenter diagnose` on a folder; return ``report``, ``wall_s``, ``cpu_s``, ``peak_mb``, ``error``.

    Where it fails there is no report, and ``error`` holds its last line. The code is that of `code_digest`, wherever
    the benchmark was started.
    """
    command = [sys.executable, "-m", "rig.cli", "diagnose", str(trials.resolve())]
    command += ["--out", str(out.resolve()), "--seed", str(seed)]
    ended = subprocess.run(
        [sys.executable, "-c", _MEASURE, *command], capture_output=True, text=True, check=True, cwd=ROOT
    )
    row: Row = json.loads(ended.stdout)
    if not row["error"]:
        row["report"] = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return row


def digest_of(package: Any) -> str:
    """Return a digest of a package's sources: what was measured with one code isn't another's."""
    digest = hashlib.sha256()
    for path in sorted(Path(package.__file__).parent.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def code_digest() -> str:
    """Return the digest of the analysis."""
    return digest_of(analysis)


def code_name() -> str:
    """Return the analysis in words: its digest, and the commit where it lies in a checkout."""
    described = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return f"analysis {code_digest()} {described.stdout.strip()}".strip()


def kept_rows(path: Path) -> list[Row]:
    """Return the rows that a campaign kept so far."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
