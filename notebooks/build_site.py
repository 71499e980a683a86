"""What the site of the documentation has beside the pages in this folder; mkdocs calls the functions.

Pages made here: README, changelog, benchmarks, citation and licence from their own files; the notebooks
as they were run; and the reference of every public name, read from the sources without importing them.
Links between files of the repository become links of the site, and formulas become MathML, which
browsers show without a script.
"""

import base64
import json
import posixpath
import re
import sys
from html import escape, unescape
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.plugins import get_plugin_logger
from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
from check_links import broken
from public_names import first_sentence, public_names

ROOT = Path(__file__).parent.parent
log = get_plugin_logger("site")

# Files of the repository that are pages elsewhere in the site; any other page keeps its name.
MOVED = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "LICENSE": "licence.md",
    "CITATION.cff": "citation.md",
    "notebooks/README.md": "studies.md",
    "tests/benchmarks/README.md": "benchmarks.md",
}
PICTURES = (".pictures/mechanism.gif", ".pictures/balance.gif")


# ------------------------------------------------------------------------------ what mkdocs calls
def on_config(config):
    """The pages of the reference stand at the end of their section."""
    sections = {name: pages for entry in config.nav for name, pages in entry.items()}
    sections["Reference"] += [{name: _page_of(name)} for name in public_names()]


def on_files(files, config):
    """Add the pages that are made here."""
    made = {page: (ROOT / source).read_text("utf-8") for source, page in MOVED.items()}
    made["licence.md"] = f"# Licence\n\n```text\n{made['licence.md']}\n```\n"
    made["citation.md"] = _citation(made["citation.md"])
    for path in _notebooks():
        text, pictures = _notebook(path)
        made[f"{path.stem}.md"] = text
        made |= pictures
    made |= {picture: (ROOT / picture).read_bytes() for picture in PICTURES}
    made |= _reference()
    for page, content in made.items():
        old = files.get_file_from_path(page)
        if old is not None:
            files.remove(old)
        # mkdocs leaves out folders whose names begin with a dot
        files.append(File.generated(config, page.lstrip("."), content=content))
    readme = files.get_file_from_path("README.md")
    files.remove(readme)
    return files


def on_page_markdown(markdown, page, config, files):
    """Links that hold in the repository, as links of the site."""
    uri = page.file.src_uri
    source = {page: source for source, page in MOVED.items()}.get(uri, f"notebooks/{uri}")
    if uri.startswith("reference/"):
        return markdown

    def moved(match):
        before, target, after = match.groups()
        return before + _site_link(source, uri, target) + after

    outside = re.split(r"(^```.*?^```$)", markdown, flags=re.M | re.S)
    for i in range(0, len(outside), 2):
        outside[i] = re.sub(r"(\]\()([^)\s]+)(\))", moved, outside[i])
        outside[i] = re.sub(r'(src=")([^"]+)(")', moved, outside[i])
    return "".join(outside)


def on_page_content(html, page, config, files):
    """Formulas as MathML."""

    def mathml(match):
        text = unescape(match[2]).strip()
        block = text.startswith("\\[")
        try:
            found = convert(text[2:-2].strip(), display="block" if block else "inline")
            # the names of functions stand apart from their arguments
            return re.sub(r"<mi>(\w\w+)</mi>", r'<mi class="function">\1</mi>', found)
        except Exception as error:  # whatever the converter stumbles over
            log.warning(f"{page.file.src_uri}: formula {text}: {type(error).__name__}: {error}")
            return match[0]

    return re.sub(r'<(span|div) class="arithmatex">(.*?)</\1>', mathml, html, flags=re.S)


def on_post_build(config):
    """Every link and anchor of the built pages leads somewhere, and nothing is loaded from a network."""
    for problem in broken(Path(config.site_dir)):
        log.warning(problem)


# ------------------------------------------------------------------------------ links
def _site_link(source, uri, target):
    """A link of a file of the repository, from its page in the site."""
    if re.match(r"[a-z]+:|#", target):
        return target
    path, _, anchor = target.partition("#")
    path = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
    if path in MOVED:
        path = MOVED[path]
    elif path == "notebooks":
        path = "studies.md"
    elif path.startswith("notebooks/"):
        path = path.removeprefix("notebooks/").replace(".ipynb", ".md")
    elif path in PICTURES:
        path = path.lstrip(".")
    else:
        log.warning(f"{source}: the site has no page for {target}")
    link = posixpath.relpath(path, posixpath.dirname(uri) or ".")
    return f"{link}#{anchor}" if anchor else link


# ------------------------------------------------------------------------------ notebooks
def _notebooks():
    return sorted(Path(__file__).parent.glob("*.ipynb"))


def _notebook(path):
    """A notebook as it was run, as a page with its pictures."""
    lines, pictures = [], {}
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        source = "".join(cell["source"])
        lines.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{path.stem}_files/{len(pictures)}.png"
                pictures[name] = base64.b64decode("".join(data["image/png"]))
                lines.append(f"![Figure {len(pictures)} of this page]({name})")
            else:
                text = "".join(output.get("text", data.get("text/plain", "")))
                lines.append(f"```text\n{text.rstrip()}\n```")
    source = f"The notebook is `notebooks/{path.name}`; what follows is as it was last run."
    return "\n\n".join([*lines, source]), pictures


# ------------------------------------------------------------------------------ reference
def _page_of(module):
    return f"reference/{module}.md"


def _home(module, name, known):
    """The module whose page describes a name of `jaxcomp` or of a module of the package."""
    if module != "jaxcomp":
        return module
    holders = [other for other, names in known.items() if other != "jaxcomp" and name in names]
    nearest = [other for other in holders if known["jaxcomp"][name].startswith(other)]
    return (nearest or holders or ["jaxcomp"])[0]


def _reference():
    """The index of all public names, and a page of each module."""
    known = public_names()
    pages, rows = {}, []
    for module, names in known.items():
        own, table = [], []
        for name in sorted(names, key=str.lower):
            home = _home(module, name, known)
            told = escape(first_sentence(names[name], name), quote=False)
            told = told.replace("|", "\\|")
            link = f"[`{name}`]({home}.md#{home}.{name})"
            table.append(f"| {link} | {told} |")
            if home == module:
                own.append(f"::: {module}.{name}\n    options:\n      heading_level: 2\n")
                rows.append((name, f"| {link} | `{home}` | {told} |"))
        head = (
            f"::: {module}\n    options:\n      members: false\n      show_root_full_path: true\n"
        )
        head += "      show_source: false\n      heading_level: 1\n"
        listing = "\n".join(["| name | what it is |", "|---|---|", *table])
        pages[_page_of(module)] = f"{head}\n{listing}\n\n" + "\n".join(own)
    rows.sort(key=lambda row: row[0].lower())
    letters = "\n".join(row for _, row in rows)
    modules = ", ".join(f"[`{name}`]({name}.md)" for name in known)
    pages["reference/index.md"] = (
        "# All public names\n\n"
        f"Modules: {modules}.\n\n"
        "What stands under `jaxcomp` is imported from there: `from jaxcomp import load`.\n\n"
        f"| name | module | what it is |\n|---|---|---|\n{letters}\n"
    )
    return pages


def _citation(text):
    return (
        "# Citation\n\nThe file `CITATION.cff` of the repository says how to cite jaxcomp. "
        "Cite the source of the machine or law that you used as well: docstrings and machine "
        f"files name it.\n\n```yaml\n{text}```\n"
    )
