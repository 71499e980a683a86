"""How the page of the desk is laid out: its looks, and where its parts stand."""

import re
from typing import Any

import panel as pn

# Punctuation; Markdown takes each as it is behind a backslash.
_SIGN = re.compile(r"([!-/:-@\[-`{-~])")
# A dark page shows every colour, also of the pictures, with its lightness turned round.
LIGHT = {"background": "white", "box-shadow": "0 0 0 24px white", "min-height": "100vh"}
DARK = LIGHT | {"filter": "invert(0.9) hue-rotate(180deg)"}
WIDE = {"sizing_mode": "stretch_width"}
# On a phone a name takes two lines rather than to lose its end.
_CELLS = """
.tabulator .tabulator-row .tabulator-cell { white-space: normal !important; overflow-wrap: anywhere;
  text-overflow: clip !important; }
.tabulator .tabulator-row .tabulator-cell * { white-space: normal !important; }
@media (max-width: 480px) {
  .tabulator .tabulator-col .tabulator-col-title { padding-right: 8px !important; }
}
"""
TABLE = {"show_index": False, "stylesheets": [_CELLS]} | WIDE
# Side by side where there is room; on a phone the first picture stands before the numbers.
_SIDES = """
:host { display: grid !important; gap: 14px; grid-template: "head head" auto "numbers first" auto
  "numbers rest" 1fr / minmax(330px, 470px) minmax(0, 1fr); }
@media (max-width: 860px) { :host { gap: 8px; grid-template: "head" auto "first" auto "numbers" auto
  "rest" auto / minmax(0, 1fr); } }
"""
_CARD = """
:host { background: white; border: 1px solid #e3e6ea; border-radius: 8px; padding: 10px;
  box-sizing: border-box; min-width: 0; }
"""
_GRID = """
:host { display: grid !important; gap: 8px;
  grid-template-columns: repeat(auto-fit, minmax(min(310px, 100%), 1fr)); }
"""


def grid(*parts: Any) -> Any:
    """Pictures side by side, as many as there is room for."""
    return pn.Column(*parts, stylesheets=[_GRID], **WIDE)


def sides(**areas: tuple) -> Any:
    """The parts of the page in the areas "head", "first", "numbers" and "rest"."""
    cards = []
    for name, parts in areas.items():
        place = {"grid-area": name}
        cards.append(pn.Column(*parts, styles=place, stylesheets=[_CARD], **WIDE))
    return pn.Column(*cards, stylesheets=[_SIDES], **WIDE)


def as_it_is(text: str) -> str:
    """A text whose signs mean nothing to Markdown and HTML, such as one from a file."""
    return _SIGN.sub(r"\\\1", text)
