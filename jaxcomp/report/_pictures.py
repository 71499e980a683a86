"""Pictures inside an HTML file, so that it needs no other."""

import base64
from html import escape
from io import BytesIO

import matplotlib
from matplotlib.figure import Figure

# A drawing with more lines than this is smaller, and faster to show, as pixels.
_LARGEST_SVG = 400_000  # bytes
_DPI = 130


def picture_html(name: str, picture: Figure | bytes) -> str:
    """A figure, which carries its title, or a moving picture (GIF) with its name below."""
    caption = ""
    if isinstance(picture, bytes):
        kind, data, told = "gif", picture, name.replace("_", " ").capitalize()
        caption = f"<figcaption>{escape(told)}</figcaption>"
    else:
        kind, data = _encoded(picture)
        told = picture.get_suptitle() or name
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"
    image = f'<img src="{source}" alt="{escape(told, quote=True)}">'
    return f"<figure>{image}{caption}</figure>"


def _encoded(figure: Figure) -> tuple[str, bytes]:
    vector = _saved(figure, "svg")
    return ("svg+xml", vector) if len(vector) <= _LARGEST_SVG else ("png", _saved(figure, "png"))


def _saved(figure: Figure, kind: str) -> bytes:
    out = BytesIO()
    # letters as outlines: the reader's machine may not have the font
    options = {"svg.fonttype": "path", "svg.hashsalt": "jaxcomp"}
    plain = {"Date": None} if kind == "svg" else None
    with matplotlib.rc_context(options):
        figure.savefig(out, format=kind, dpi=_DPI, metadata=plain)
    return out.getvalue()
