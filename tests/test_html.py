"""A report as one HTML file: whole, well-formed, loading nothing, seen in a browser."""

import base64
import io
import re
import sys

import numpy as np
import pytest
from html_page import Page, mailable, opened
from matplotlib import image
from test_plotting import make_run

from tuning.reporting.html import write_html
from tuning.reporting.tracks import check_plotly, interactive_tracks

TEXT = """# Tuning fxtppc: switching on `rigid-body`

80 steps. **Held out**, see [how](docs/tuning.md) 1 < 2 & 3.

> a note
> another one

- before: lost
- after: found

| channel | rms error |
|---|---:|
| depth [m] | 0.1 |
| `a<b` | - |

```
$ if (x < 1) && y
```

![errors](errors.png)
![lost](gone.png)
"""
PINK = (230, 0, 126)
LOADED = """<script>
addEventListener("load", () => {
  document.title = "loaded " + performance.getEntriesByType("resource").length;
});
</script>"""
MEASURE = """<script>
const pictures = [...document.images].map(x => x.naturalWidth + "x" + x.width);
document.title = document.documentElement.scrollWidth + ";" + pictures.join(";");
</script>"""


@pytest.fixture
def page(tmp_path):
    pixels = np.zeros((4, 6, 3), np.uint8)
    pixels[1, 2] = 255
    image.imsave(tmp_path / "errors.png", pixels)
    about = {
        "command": ["tune", "--gains", "my gains.toml"],
        "created": "2030-01-01",
        "versions": {"jax": "0.10"},
        "campaign": "x" * 500,
    }
    write_html(tmp_path / "report.html", TEXT, about, [tmp_path / "errors.png"])
    text = (tmp_path / "report.html").read_text()
    return text, mailable(tmp_path / "report.html"), pixels


def test_every_tag_is_closed_and_the_text_is_all_there(page):
    _, parsed, _ = page
    assert parsed.texts["title"] == ["Tuning fxtppc: switching on `rigid-body`"]
    assert "".join(parsed.texts["h1"]) == "Tuning fxtppc: switching on "
    assert parsed.texts["th"] == ["channel", "rms error"]
    assert parsed.texts["td"][:2] == ["depth [m]", "0.1"]
    assert "a<b" in parsed.texts["code"]
    assert "$ if (x < 1) && y" in "".join(parsed.texts["code"])
    assert parsed.texts["blockquote"] == ["a note", "another one"]
    assert parsed.texts["li"] == ["before: lost", "after: found"]
    assert ", see how 1 < 2 & 3." in "".join(parsed.texts["p"])
    assert parsed.texts["strong"] == ["Held out"]
    assert "Lost: not drawn." in parsed.texts["p"]


def test_pictures_stand_in_the_page_and_nothing_is_loaded(page):
    text, parsed, pixels = page
    assert len(parsed.loads) == 2
    for source in parsed.loads:
        assert source.startswith("data:image/png;base64,")
        data = base64.b64decode(source.split(",")[1])
        drawn = image.imread(io.BytesIO(data), format="png")[:, :, :3]
        np.testing.assert_allclose(drawn, pixels / 255.0, atol=1e-6)
    assert "http" not in text.replace("http-equiv", "")


def test_the_command_that_repeats_it_and_its_origin_are_told(page):
    _, parsed, _ = page
    assert "jaxglider tune --gains 'my gains.toml'" in parsed.texts["code"]
    cells = parsed.texts["td"]
    assert cells[cells.index("versions.jax") + 1] == "0.10"
    assert "campaign" not in cells


def test_a_page_that_is_not_whole_is_found():
    with pytest.raises(AssertionError):
        Page("<p><b>text</p></b>")
    with pytest.raises(AssertionError):
        Page("<table><tr></tr>")


def test_a_browser_shows_the_page_as_wide_as_its_window(tmp_path):
    """A wide table scrolls by itself, pictures shrink with the window and are seen."""
    wide = "| " + " | ".join(f"column {n} [rad/s]" for n in range(30)) + " |"
    rule = "|" + "---:|" * 30
    text = "\n".join(["# Wide", "", wide, rule, wide.replace("column", "value")])
    pixels = np.full((300, 1050, 3), PINK, np.uint8)
    image.imsave(tmp_path / "pink.png", pixels, dpi=300)
    path = tmp_path / "report.html"
    write_html(path, text, {"command": ["tune"]}, [tmp_path / "pink.png"])
    mailable(path)
    path.write_text(path.read_text().replace("</body>", MEASURE + "</body>"))
    seen = {}
    for width in (1200, 500):
        document, picture = opened(path, tmp_path, width)
        seen[width] = re.search("<title>(.*)</title>", document)[1]
        shown = (image.imread(picture)[:, :, :3] * 255.0).round()
        found = np.argwhere(np.abs(shown - PINK).max(axis=2) < 3.0)
        box = found.max(axis=0) - found.min(axis=0) + 1
        # 3.5 inches of print at 136 pixels each, or what the window leaves.
        wanted = min(136 * 3.5, width - 32)
        assert box[1] == pytest.approx(wanted, abs=3)
        assert box[0] == pytest.approx(wanted * 300 / 1050, abs=3)
    assert seen == {1200: "1200;1050x476", 500: "500;1050x468"}


def test_tracks_stand_in_the_page_and_move(tmp_path):
    """They load nothing, and the browser draws a line for each run in each panel."""
    runs = {"SMC": make_run(), "PID": make_run(error_scale=-1.0)}
    piece = interactive_tracks(runs, "case: glider (plant)")
    path = tmp_path / "report.html"
    write_html(path, "# Flight", {"command": ["simulate"]}, tracks=[piece])
    page = mailable(path)
    assert page.texts["h2"][0] == "Tracks"
    path.write_text(path.read_text().replace("</body>", LOADED + "</body>"))
    document, _ = opened(path, tmp_path)
    assert "<title>loaded 0</title>" in document
    assert len(re.findall('class="trace scatter', document)) == 8
    assert "case: glider (plant)" in document


def test_tracks_are_refused_before_the_work_where_they_cannot_be_drawn(monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly.subplots", None)
    with pytest.raises(ValueError, match="needs the package plotly"):
        check_plotly()
