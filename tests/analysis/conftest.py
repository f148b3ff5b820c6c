"""Pages and figures looked at as a person would: is text cut off or printed over, is a figure empty?"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from html import unescape
from pathlib import Path
from typing import Any

import pytest

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


def _faults_of_page(page: Path, profile: Path) -> list[str]:
    """Return what a real browser cuts off of a page, and the images that show nothing."""
    if BROWSER is None:
        pytest.skip("no browser of the Chromium family is installed: the page itself was not looked at")
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
    assert found["images"] > 0
    faults = [f"cut off: {words}" for words in found["cut"]]
    faults += [f"empty: {words}" for words in found["empty"]]
    return [*faults, *(["the page is wider than the window"] if found["wide"] else [])]


def _texts_of(figure: Any) -> tuple[list[str], list[str]]:
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


@contextmanager
def _watched_figures() -> Iterator[list[str]]:
    from matplotlib.figure import Figure

    save = Figure.savefig
    faults: list[str] = []

    def checked(figure: Any, name: Any, **kwargs: Any) -> None:
        save(figure, name, **kwargs)
        if isinstance(name, Path) and name.suffix == ".png":
            outside, overprinted = _texts_of(figure)
            faults.extend(f"{name.stem}: beyond the figure: {text}" for text in outside)
            faults.extend(f"{name.stem}: ticks printed over each other: {text}" for text in overprinted)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", checked)
        yield faults


@pytest.fixture(scope="session")
def watched_figures() -> Callable[[], AbstractContextManager[list[str]]]:
    """Context manager in which figures are drawn; yields the faults of their texts."""
    return _watched_figures


@pytest.fixture(scope="session")
def page_faults(tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], list[str]]:
    """Function (page) -> what a real browser cuts off of it, or shows empty; skips without a browser."""
    profile = tmp_path_factory.mktemp("browser")
    return lambda page: _faults_of_page(page, profile)
