"""The page of fits for any experiment: in a real browser nothing is cut off, and no figure is empty."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.recordings import write_trial
from analysis.recordings.importing import import_recordings
from analysis.recordings.trial import Trial
from analysis.relaxation.batch import fit_paths

RECORDINGS = Path(__file__).parents[3].parent / "shared" / "recordings"
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--window-size=1280,900"),
    "--virtual-time-budget=20000",
)

# what is looked for: text wider than its box, images that did not load or show one colour
LOOK = """<script>addEventListener('load', () => {
  const wide = document.documentElement.scrollWidth > innerWidth;
  const found = {cut: [], empty: [], images: document.images.length, wide};
  for (const e of document.querySelectorAll('h1,h2,p,td,th,li,figcaption,summary')) {
    if (e.clientWidth && e.scrollWidth > e.clientWidth + 1) found.cut.push(e.textContent.slice(0, 60));
  }
  for (const image of document.images) {
    const canvas = document.createElement('canvas');
    canvas.width = 60; canvas.height = 60;
    const at = canvas.getContext('2d');
    at.drawImage(image, 0, 0, 60, 60);
    const seen = new Set(new Uint32Array(at.getImageData(0, 0, 60, 60).data.buffer));
    if (!image.naturalWidth || seen.size < 20) found.empty.push(image.alt);
  }
  document.body.innerHTML = '<pre id="found">' + JSON.stringify(found) + '</pre>';
});</script>"""


def looked_at(page: Path, profile: Path) -> dict[str, Any]:
    assert BROWSER is not None
    marked = page.with_name("looked_at.html")
    marked.write_text(page.read_text(encoding="utf-8").replace("</body>", LOOK + "</body>"), encoding="utf-8")
    done = subprocess.run(
        [BROWSER, *FLAGS, f"--user-data-dir={profile}", "--dump-dom", marked.as_uri()],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    text = re.search(r'<pre id="found">(.*?)</pre>', done.stdout, re.DOTALL)
    assert text is not None, done.stdout[-500:]
    found: dict[str, Any] = json.loads(unescape(text[1]))
    return found


def texts_of(figure: Any) -> tuple[list[str], list[str]]:
    """Return the texts of a figure that reach beyond it, and the axes whose tick labels overlap."""
    figure.draw_without_rendering()
    texts = [text for legend in figure.legends for text in legend.get_texts()]
    overprinted = []
    for axes in (axes for axes in figure.axes if axes.get_visible()):
        legend = axes.get_legend()
        texts += [axes.xaxis.label, axes.yaxis.label, axes.title, *(legend.get_texts() if legend else [])]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            shown = [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            shown = [label for label in shown if label.get_visible() and label.get_text()]
            texts += shown
            boxes = [label.get_window_extent() for label in shown]
            if any(a.overlaps(b) for a, b in zip(boxes, boxes[1:], strict=False)):
                overprinted.append(axis.label.get_text())
    frame, outside = figure.bbox.padded(1.0), []
    for text in texts:
        box = text.get_window_extent()
        if text.get_text().strip() and not (
            frame.contains(box.x0, box.y0) and frame.contains(box.x1, box.y1)
        ):
            outside.append(text.get_text())
    return outside, overprinted


class Fitted:
    """Pages of fits, made once a kind, their figures' texts looked at while they are drawn."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.pages: dict[str, Path] = {}
        self.outside: dict[str, list[str]] = {}
        self.overprinted: dict[str, list[str]] = {}

    def page(self, kind: str, trials: Path) -> Path:
        """Return the page of a folder of trials."""
        if kind in self.pages:
            return self.pages[kind]
        from matplotlib.figure import Figure

        save = Figure.savefig
        outside: list[str] = []
        overprinted: list[str] = []

        def checked(figure: Any, name: Path, **kwargs: Any) -> None:
            save(figure, name, **kwargs)
            if name.suffix == ".png":
                beyond, over = texts_of(figure)
                outside.extend(beyond)
                overprinted.extend(over)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Figure, "savefig", checked)
            self.pages[kind] = fit_paths([trials], out=self.folder / kind, jobs=1)
        self.outside[kind], self.overprinted[kind] = outside, overprinted
        return self.pages[kind]


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    return Fitted(tmp_path_factory.mktemp("pages"))


@pytest.fixture(scope="module")
def fingers(simulate: Callable[..., Trial], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fingers")
    for number, (finger, depth) in enumerate((f, d) for f in ("index", "thumb") for d in (0.2, 0.4, 0.8)):
        write_trial(
            folder / f"{finger}_{depth}.h5",
            simulate(depth, seed=number, finger=finger, hold_s=2.0, dwell_s=0.3),
        )
    return folder


@pytest.fixture(scope="module")
def gels(convex: Callable[..., Trial], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gels")
    for number, depth in enumerate((2.0, 2.05, 6.0)):
        trial = convex(
            1.5, rate_hz=20.0, depth_mm=depth, ramp_s=1.0, hold_s=25.0, seed=number, signal_to_noise=300.0
        )
        write_trial(folder / f"gel_{number}.h5", trial)
    lost = convex(1.5, rate_hz=20.0, shares=(0.0, 0.0), signal_to_noise=20.0)
    write_trial(folder / "hardly_relaxes.h5", replace(lost, log=("imported from a stranger's file",)))
    return folder


def recordings(kind: str, tmp_path: Path) -> Path:
    if not RECORDINGS.is_dir():
        pytest.skip("the real recordings are not beside the project")
    if kind == "afm_relaxation":
        pytest.importorskip("afmformats")
    import_recordings([RECORDINGS / kind], tmp_path / "trials")
    return tmp_path / "trials"


@pytest.mark.parametrize("kind", ["fingers", "gels", "aurora_ddf", "afm_relaxation"])
def test_nothing_is_cut_off_or_overprinted_and_no_figure_is_empty(
    kind: str, fitted: Fitted, request: pytest.FixtureRequest, tmp_path: Path
):
    trials = request.getfixturevalue(kind) if kind in {"fingers", "gels"} else recordings(kind, tmp_path)
    page = fitted.page(kind, trials)
    assert fitted.outside[kind] == []
    assert fitted.overprinted[kind] == []
    if BROWSER is None:
        pytest.skip("no browser of the Chromium family is installed: the page itself was not looked at")
    found = looked_at(page, tmp_path / "profile")
    assert found["images"] > 0
    assert found["cut"] == []
    assert found["empty"] == []
    assert not found["wide"]


def test_the_finger_study_stands_beside_fingers_alone(gels: Path, fingers: Path, fitted: Fitted):
    of_gels, of_fingers = fitted.page("gels", gels).read_text(), fitted.page("fingers", fingers).read_text()
    assert "Beside the published study" in of_fingers
    assert "finger" not in re.sub(r"data:image/png;base64,[^\"]*", "", of_gels)
    assert "p of d^p" in of_gels
    assert "% of peak" in of_gels
    assert "imported from a stranger" in of_gels
    numbers = re.findall(r"<td>([^<]*±[^<]*)</td>", of_gels)
    assert numbers
    for text in numbers:
        value, error = (float(re.sub(r"[()]|e-?\d+", "", part)) for part in text.split("±"))
        assert error < max(10 * abs(value), 1e-9), text


def test_what_is_not_told_is_left_empty(gels: Path, fitted: Fitted):
    document = json.loads((fitted.page("gels", gels).parent / "fits.json").read_text())
    (lost,) = [trial for trial in document["trials"] if trial["file"] == "hardly_relaxes.h5"]
    assert lost["failure"] or {"t1_s", "t2_s"} & lost["untold"].keys()
    assert not {"t1_s", "t2_s"} <= lost.keys()
    means = document["study"]["groups"][-1]["columns"]
    told = [trial["t1_s"]["value"] for trial in document["trials"] if "t1_s" in trial]
    assert means["t1_s"]["mean"] == pytest.approx(np.mean(told))
