"""A report as one HTML file: whole, well-formed, and loading nothing."""

import base64
import html.parser
import io

import numpy as np
import pytest
from matplotlib import image

from tuning.reporting.html import write_html

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
VOID = {"meta", "img"}


class Page(html.parser.HTMLParser):
    """Tags in their order, text by tag, and everything that a page would load."""

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.loads = [], {}, []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        self.loads += [v for k, v in attributes if k in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data)


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
    return text, Page(text), pixels


def test_every_tag_is_closed_and_the_text_is_all_there(page):
    _, parsed, _ = page
    assert parsed.open == []
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
    assert "lost: not drawn." in parsed.texts["p"]


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
