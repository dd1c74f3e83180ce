"""Parts of the page in HTML: figures, tables, and words in place of a figure."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

STYLE = Path(__file__).with_name("report.css")


def figure(title: str, drawn: str, text: str, kind: str = "") -> str:
    """Return a figure; `drawn` and `text` are HTML of ours."""
    caption = f"<figcaption><h2>{title}</h2><p>{text}</p></figcaption>"
    return f'<figure class="{kind}">{caption}<div class="scroll">{drawn}</div></figure>'


def missing(title: str, why: str) -> str:
    """Return what stands where a figure cannot be drawn."""
    return f"<section><h2>{title}</h2><p>Not drawn: {why}</p></section>"


def table(heads: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "") -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    made = f'<table class="{kind}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
    return f'<div class="scroll">{made}</div>'
