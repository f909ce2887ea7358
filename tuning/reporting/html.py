"""Reports as one HTML file that stands by itself: text, tables and figures within it.

The text of a report is Markdown, of which this turns what the reports use into HTML:
headings, paragraphs, quotes, lists, tables, blocks of code, pictures. Pictures stand in
the page as data, so that it can be mailed; it loads nothing.
"""

import base64
import html
import io
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from PIL import Image

from jaxglider.files.writing import write_text

STYLE = """
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem; line-height: 1.45;
       font-family: system-ui, sans-serif; color: #1b1f24; background: #fff; }
h2 { margin-top: 2.2rem; border-bottom: 1px solid #d8dee4; padding-bottom: .2rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: .88rem;
        font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .6rem; border-bottom: 1px solid #d8dee4; text-align: left; }
th { border-bottom: 2px solid #8c959f; vertical-align: bottom; }
td:first-child, .n { white-space: nowrap; } .n { text-align: right; }
.figures { display: flex; flex-wrap: wrap; gap: 1rem; align-items: flex-start; }
figure { margin: 0; max-width: 100%; break-inside: avoid; }
img { max-width: 100%; height: auto; }
figcaption { color: #57606a; font-size: .9rem; }
pre, code { background: #f3f4f6; border-radius: 4px; }
pre { padding: .6rem .8rem; overflow-x: auto; } code { padding: 0 .2rem; }
pre code { padding: 0; }
blockquote { margin: .3rem 0; padding-left: .8rem; border-left: 3px solid #d4a72c; }
.wide { overflow-x: auto; }
"""
_PIXELS_AN_INCH = 136.0
"""Size at which figures are shown: two of a journal's columns stand side by side."""


def write_html(
    path: Path,
    text: str,
    about: Mapping[str, Any],
    figures: Sequence[Path] = (),
    tracks: Sequence[str] = (),
) -> None:
    """Write a report as one HTML file.

    Args:
        path: path of the file; pictures in the text count from its folder.
        text: report in Markdown; its first heading is the title.
        about: provenance; its `command` is the one to repeat.
        figures: pictures that follow the text, where it does not have them already.
        tracks: pieces of HTML that stand before the pictures.
    """
    body = list(_blocks(text, path.parent))
    if tracks:
        body += ["<h2>Tracks</h2>", *tracks]
    if figures:
        body += ["<h2>Figures</h2>", *_side_by_side(map(_picture, figures))]
    title = re.search(r"^# (.*)$", text, re.MULTILINE)
    write_text(
        path,
        "<!DOCTYPE html>\n"
        '<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{html.escape(title[1] if title else path.stem)}</title>"
        f"<style>{STYLE}</style></head>\n<body>\n"
        + "\n".join([*body, *_provenance(about)])
        + "\n</body></html>\n",
    )


def _provenance(about: Mapping[str, Any]) -> Iterator[str]:
    """The command that repeats the result, and its origin."""
    command = about.get("command")
    yield "<h2>Where this comes from</h2>"
    if command:
        words = [command] if isinstance(command, str) else list(command)
        line = words[0] if len(words) == 1 else shlex.join(words)
        if not line.startswith("jaxglider"):
            line = f"jaxglider {line}"
        yield f"<p>To repeat it:</p>\n<pre><code>{html.escape(line)}</code></pre>"
    rows = list(_flat("", {k: v for k, v in about.items() if k != "command"}))
    yield from _table([["", ""], ["---", "---"], *([k, v] for k, v in rows)])


def _flat(path: str, value: Any) -> Iterator[tuple[str, str]]:
    """Paths and texts of nested tables; what is long is left to the JSON files."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _flat(f"{path}.{key}".strip("."), inner)
    elif value is not None and len(str(value)) < 200:
        yield path, str(value)


def _blocks(text: str, folder: Path) -> Iterator[str]:
    """The blocks of a Markdown text, one after the other."""
    lines, here = text.splitlines(), 0
    while here < len(lines):
        line = lines[here]
        kind = _kind(line)
        end = here + 1
        if kind == "code":
            end = (
                lines.index("```", here + 1)
                if "```" in lines[here + 1 :]
                else len(lines)
            )
            inner = html.escape("\n".join(lines[here + 1 : end]))
            yield f"<pre><code>{inner}</code></pre>"
            end += 1
        elif kind in ("table", "list", "quote", "text"):
            while end < len(lines) and _kind(lines[end]) == kind:
                end += 1
            yield from _run(kind, lines[here:end])
        elif kind == "heading":
            marks, words = line.split(" ", 1)
            yield f"<h{len(marks)}>{_inline(words)}</h{len(marks)}>"
        elif kind == "picture":
            while end < len(lines) and _kind(lines[end]) in ("picture", ""):
                end += 1
            found = re.findall(r"!\[(.*?)\]\((.*?)\)", "\n".join(lines[here:end]))
            yield from _side_by_side(_picture(folder / p, name) for name, p in found)
        here = end


def _kind(line: str) -> str:
    """Kind of block that a line of Markdown belongs to; empty for an empty line."""
    starts = {
        "```": "code",
        "|": "table",
        "- ": "list",
        "> ": "quote",
        "![": "picture",
    }
    if re.match(r"#{1,4} ", line):
        return "heading"
    for start, kind in starts.items():
        if line.startswith(start):
            return kind
    return "text" if line.strip() else ""


def _run(kind: str, lines: Sequence[str]) -> Iterator[str]:
    """Lines of one kind as HTML."""
    if kind == "table":
        rows = [
            [c.strip() for c in line.strip().strip("|").split("|")] for line in lines
        ]
        yield from _table(rows)
    elif kind == "list":
        yield "<ul>"
        for line in lines:
            yield f"<li>{_inline(line[2:])}</li>"
        yield "</ul>"
    elif kind == "quote":
        for line in lines:
            yield f"<blockquote>{_inline(line[2:])}</blockquote>"
    else:
        yield f"<p>{_inline(' '.join(lines))}</p>"


def _table(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """A table: titles, alignments, then the rows."""
    if len(rows) < 2:
        return
    head, rule, *body = rows
    right = [cell.endswith(":") for cell in rule]

    def row(cells: Sequence[str], tag: str) -> str:
        inner = "".join(
            f"<{tag}{' class=n' if n < len(right) and right[n] else ''}>"
            f"{_inline(cell)}</{tag}>"
            for n, cell in enumerate(cells)
        )
        return f"<tr>{inner}</tr>"

    yield '<div class="wide"><table>'
    if any(head):
        yield row(head, "th")
    for cells in body:
        yield row(cells, "td")
    yield "</table></div>"


def _inline(text: str) -> str:
    """A line with its code, its bold words and its links, everything else escaped."""
    parts = re.split(r"(`[^`]*`)", text)
    for n, part in enumerate(parts):
        if part.startswith("`") and part.endswith("`") and len(part) > 1:
            parts[n] = f"<code>{html.escape(part[1:-1])}</code>"
            continue
        plain = html.escape(part, quote=False)
        plain = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", plain)
        # Files beside the report are not mailed with it: their names stay.
        parts[n] = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", plain)
    return "".join(parts)


def _side_by_side(pictures: Iterable[str]) -> Iterator[str]:
    """Pictures in rows, as many in each as there is room for."""
    yield '<div class="figures">'
    yield from pictures
    yield "</div>"


def _picture(path: Path, title: str = "") -> str:
    """A picture as data in the page, in proportion to its size in print."""
    words = title or path.stem.replace("_", " ")
    name = html.escape(words[:1].upper() + words[1:])
    if not path.is_file():
        return f"<p>{name}: not drawn.</p>"
    content = path.read_bytes()
    with Image.open(io.BytesIO(content)) as picture:
        pixels = picture.width
        dense = float(picture.info.get("dpi", (100.0, 100.0))[0])
    data = base64.b64encode(content).decode("ascii")
    return (
        f'<figure><img alt="{name}" width="{_PIXELS_AN_INCH * pixels / dense:.0f}" '
        f'src="data:image/png;base64,{data}">'
        f"<figcaption>{name}</figcaption></figure>"
    )
