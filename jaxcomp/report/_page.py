"""The page: what was asked, whether it can be trusted, what came out, and what it stands on."""

import datetime
import platform
import re
from collections.abc import Iterable, Mapping
from html import escape
from importlib import resources
from importlib.metadata import version
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from ..scene import Scene
from ._checks import Check, checks
from ._pictures import picture_html
from ._sources import sources_html
from ._tables import numbers_html, tables_html


class Made(NamedTuple):
    """How a report came about.

    Attributes:
        command: the command line.
        versions: version by name of the library.
        at: date and time.
    """

    command: str
    versions: Mapping[str, str]
    at: str

    @classmethod
    def now(cls, command: str) -> "Made":
        """With the libraries of this process, at this moment."""
        versions = {name: version(name) for name in ("jaxcomp", "jax", "jaxlib", "numpy")}
        versions["Python"] = platform.python_version()
        return cls(command, versions, datetime.datetime.now().strftime("%Y-%m-%d %H:%M"))


def report(
    result: Mapping[str, Any],
    tables: Iterable[Any],
    pictures: Mapping[str, Figure | bytes],
    scene: Scene | None,
    made: Made,
) -> str:
    """A report as one HTML document that loads nothing else.

    Args:
        result: what the command found, as plain numbers; its evidence becomes the checks.
        tables: tables and lines of `rich`; the single numbers of `result` if there are none.
        pictures: figures, or the bytes of a GIF, by name.
        scene: what was worked on; its values are listed with their sources.
        made: how this came about.
    """
    name = str(scene.name if scene is not None else result.get("machine", "jaxcomp"))
    lead = "" if scene is None else f'<p class="lead">{escape(scene.description)}</p>'
    shown = tables_html(tables) or numbers_html(result)
    parts = [
        f"<header><h1>{escape(name)}</h1>{lead}{_made(made)}</header>",
        _section("Results", shown),
        _section("Pictures", "".join(picture_html(*pair) for pair in pictures.items())),
        _checks(checks(result)),
        "" if scene is None else _section("The machine and its sources", sources_html(scene)),
    ]
    titles = re.findall(r"<h2 id=\"([^\"]*)\">(.*?)</h2>", "".join(parts))
    links = "".join(f'<a href="#{place}">{title}</a>' for place, title in titles)
    parts.insert(1, f"<nav>{links}</nav>")
    style = (resources.files("jaxcomp.report") / "style.css").read_text("utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(name)}: jaxcomp</title><style>{style}</style></head>\n"
        f"<body>{''.join(parts)}</body></html>\n"
    )


def _made(made: Made) -> str:
    libraries = ", ".join(f"{name} {number}" for name, number in made.versions.items())
    return f'<pre class="command">{escape(made.command)}</pre><p class="faint">{escape(made.at)}, {escape(libraries)}</p>'  # noqa: E501


def _checks(found: tuple[Check, ...]) -> str:
    if not found:
        return ""
    rows = "".join(
        f'<tr><td class="{"good" if check.good else "bad"}">{"good" if check.good else "bad"}</td>'
        f"<td>{escape(check.name)}</td><td>{escape(check.found)}</td>"
        f'<td class="faint">{escape(check.wanted)}</td></tr>'
        for check in found
    )
    head = "<tr><th></th><th>Check</th><th>Found</th><th>Wanted</th></tr>"
    return _section("Checks", f"<table><thead>{head}</thead><tbody>{rows}</tbody></table>")


def _section(title: str, inside: str) -> str:
    place = re.sub(r"\W+", "-", title.lower())
    inside = re.sub(
        r"(<table\b.*?</table>)", r'<div class="wide">\1</div>', inside, flags=re.DOTALL
    )
    return f'<section><h2 id="{place}">{title}</h2>{inside}</section>\n' if inside else ""
