"""A page read as strictly as a browser is lenient, and one opened in a browser."""

import html.parser
import shutil
import subprocess

import pytest

VOID = {"meta", "img", "br"}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
QUIET = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
]


class Page(html.parser.HTMLParser):
    """Tags in their order, text by tag, and everything that a page would load.

    Refuses tags that are not closed in their order.
    """

    def __init__(self, text):
        super().__init__()
        self.open, self.texts, self.loads, self.styles = [], {}, [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        self.loads += [v for k, v in attributes if k in ("src", "href", "srcset")]
        self.styles += [v for k, v in attributes if k == "style"]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data)


def mailable(path):
    """The page of a file, which has to be whole, well-formed and to load nothing.

    What a script would load is seen in a browser only.
    """
    page = Page(path.read_text(encoding="utf-8"))
    assert all(x.startswith("data:image/png;base64,") for x in page.loads)
    for text in (*page.texts["style"], *page.styles):
        assert "@import" not in text
        assert "url(" not in text
    return page


def opened(path, folder, width=1200, height=900):
    """What a browser makes of a page: its document as text, and a picture of it.

    Skips the test where no browser is installed.
    """
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no Chromium is installed")
    picture = folder / "screenshot.png"
    for wanted in (["--dump-dom"], [f"--screenshot={picture}"]):
        # A profile of its own: another browser may be open.
        profile = folder / wanted[0].strip("-").partition("=")[0]
        run = subprocess.run(
            [
                browser,
                *QUIET,
                f"--user-data-dir={profile}",
                f"--window-size={width},{height}",
                *wanted,
                path.as_uri(),
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        if wanted == ["--dump-dom"]:
            document = run.stdout
    return document, picture
