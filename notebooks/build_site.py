"""The site of the documentation: its pages as Markdown, before the build, and a check of what was built.

    python notebooks/build_site.py          # pages to out/pages, the configuration to out/mkdocs.yml
    python notebooks/build_site.py finish   # formulas of the built pages as MathML, and their links

Between the two a builder that reads MkDocs' configuration makes the site: MkDocs, ProperDocs, Zensical.

Pages made here: README, changelog, benchmarks, citation and licence from their own files; the notebooks
as they were run; the bundled machines; every quantity and every entry of a machine file; and the
reference of every public name, read from the sources without importing them. Links between files of the
repository become links of the site. Formulas become MathML, which browsers show without a script.
"""

import base64
import json
import posixpath
import re
import shutil
import sys
from html import escape, unescape
from pathlib import Path

import yaml
from check_links import broken
from public_names import first_sentence, public_names

from jaxcomp import scene
from jaxcomp._core.registry import registered
from jaxcomp.scene._explain import explained, part_places

ROOT = Path(__file__).parent.parent
OUT = ROOT / "out"

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
# What search shows first and last.
BOOSTS = {
    "reference/machines.md": 2,
    "reference/entries.md": 4,
    "reference/quantities.md": 4,
    "benchmarks.md": 0.3,
    "changelog.md": 0.2,
    "licence.md": 0.1,
    "reference/index.md": 0.2,
}
# Of the pages that lead through a task, which stand before what only mentions its words.
OF_TASKS = 20
# Words of tasks: names in tables of the reference, which search puts first, are such words as well.
TASK_WORDS = {
    "balance-measured.md": "balance balancing",
    "blends.md": "blend mixture refrigerant composition",
    "identify.md": "identify measured",
    "journal-loads.md": "bearing journal film",
    "many-designs.md": "sweep optimise pareto tolerance cluster",
    "own-laws.md": "gas valve motor friction law",
    "process.md": "stage stages api unloader pocket",
    "refrigeration.md": "cop capacity map valve refrigeration",
    "scripts.md": "json script schema",
    "vibration.md": "vibration modes balance campbell",
}
# Modules with so many names that they have several pages: the files that each page describes.
PARTS = {
    "jaxcomp.study": {
        "designs": "_analysis _options _problem _rules _variables",
        "running": "_steady_state _load_steps _rotor_response _api_618",
        "comparing": "_compared _sensitivity",
        "optimising": "_optimise _optimum _pareto",
        "measurements": "identification._crank_tests identification._measurement "
        "identification._readings identification._rotor_tests",
        "identifying": "identification",
    },
    "jaxcomp.rotor": {
        "model": "_model _nodes _bodies _shaft _crankshaft _conventions",
        "links": "_links",
        "motion": "",
    },
}
# Pictures of studies on the front page, by their number in the notebook.
GALLERY = {
    "whole_compressor": 0, "valves": 0, "identified_machines": 0, "balance": 0, "tolerances": 0,
    "several_cylinders": 2, "pipes": 0, "process_compressor": 0, "journal_films": 1,
    "optimal_bore": 0, "sweeps": 0, "transients": 2,
}  # fmt: skip


# ------------------------------------------------------------------------------ the two steps
def write_pages(out: Path = OUT) -> list[str]:
    """Write pages and configuration; what is wrong with them."""
    pages = {path.name: path.read_text("utf-8") for path in _beside("*.md")}
    del pages["README.md"]
    pages |= {page: (ROOT / source).read_text("utf-8") for source, page in MOVED.items()}
    pages["index.md"] = f"---\nhide: [navigation]\n---\n\n{pages['index.md']}"
    pages["licence.md"] = f"# Licence\n\n```text\n{pages['licence.md']}\n```\n"
    pages["citation.md"] = _citation(pages["citation.md"])
    files = {
        path.name: path.read_bytes() for end in ("svg", "css", "js") for path in _beside(f"*.{end}")
    }
    # builders leave out folders whose names begin with a dot
    files |= {picture.lstrip("."): (ROOT / picture).read_bytes() for picture in PICTURES}
    for path in _beside("*.ipynb"):
        pages[f"{path.stem}.md"], pictures = _notebook(path)
        files |= pictures
    problems: list[str] = []
    pages = {page: _with_site_links(page, text, problems) for page, text in pages.items()}
    pages["index.md"] = _with_gallery(pages["index.md"])
    pages |= _reference()
    pages["reference/machines.md"] = _machines()
    pages["reference/entries.md"] = _entries()
    pages["reference/quantities.md"] = _quantities()
    settings = yaml.safe_load((ROOT / ".mkdocs.yml").read_text("utf-8"))
    sections = {name: entries for entry in settings["nav"] for name, entries in entry.items()}
    of_tasks = [*sections["Start"], *sections["How to"], *sections["Write your own"]]
    boosts = dict.fromkeys(of_tasks, OF_TASKS) | BOOSTS
    for page in pages:
        boost = boosts.get(page, 0.4 if page.startswith("reference/") else None)
        if boost:
            # a row is found by its name as a title is
            is_table = page.startswith("reference/") and boost > 1
            names = re.findall(r"^\| `(\w+)", pages[page], re.M) if is_table else []
            names += TASK_WORDS.get(page, "").split()
            head = {"search": {"boost": boost}, "tags": sorted(set(names))}
            pages[page] = f"---\n{yaml.safe_dump(head)}---\n\n{pages[page]}"
    shutil.rmtree(out / "pages", ignore_errors=True)
    for name, content in (files | {page: text.encode() for page, text in pages.items()}).items():
        path = out / "pages" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    sections["Reference"] += _entries_of_modules()
    (out / "mkdocs.yml").write_text(yaml.safe_dump(settings, sort_keys=False), "utf-8")
    (out / "pages" / "llms.txt").write_text(_index_for_programs(pages, settings), "utf-8")
    return problems


def _index_for_programs(pages: dict[str, str], settings: dict) -> str:
    """The pages that programs are told of, by the convention of llms.txt: titles and first sentences."""
    lines = [f"# {settings['site_name']}\n", f"> {settings['site_description']}\n"]
    lines += ["Begin with [the page for scripts and assistants](scripts.html).\n"]
    for section in settings["nav"]:
        for name, entries in section.items():
            listed = [entries] if isinstance(entries, str) else entries
            lines += [f"## {name}\n", *_entries_for_programs(pages, listed), ""]
    return "\n".join(lines)


def _entries_for_programs(pages: dict[str, str], entries: list) -> list[str]:
    """Lines of pages, with those of sections within; the reference of packages tells itself."""
    lines = []
    for entry in entries:
        if isinstance(entry, dict):
            (inner,) = entry.values()
            lines += _entries_for_programs(pages, inner) if isinstance(inner, list) else []
            continue
        title, _, below = pages[entry].partition("# ")[2].partition("\n")
        prose = re.sub(r"^```.*?^```", "", below, flags=re.M | re.S)
        prose = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", prose)
        paragraph = re.search(r"(?<=\n\n)[A-Z`].*?(?=\n\n|\Z)", f"\n{prose}", re.S)
        sentence = ""
        if paragraph:
            sentence = re.split(r"(?<=(?<!al)[.:]) (?=[A-Z`])", paragraph[0].replace("\n", " "))[0]
        lines.append(f"- [{title}]({entry[:-3]}.html): {sentence}")
    return lines


def finish(out: Path = OUT) -> list[str]:
    """Write formulas of the built pages as MathML; what is wrong with them, with links and with loads."""
    problems = []
    for path in (out / "site").rglob("*.html"):
        text = path.read_text("utf-8")
        html = _with_mathml(text, path.name, problems)
        if html != text:
            path.write_text(html, "utf-8")
    return problems + list(broken(out / "site"))


def _with_gallery(page: str) -> str:
    """The front page with pictures of the studies, each leading to its own."""
    figures = []
    for study, number in GALLERY.items():
        markdown, _ = _notebook(Path(__file__).parent / f"{study}.ipynb")
        title = _cell(re.search(r"^# (.*)$", markdown, re.M)[1].replace("`", ""))
        picture = f'<img src="{study}_files/{number}.png" alt="" loading="lazy">'
        figures.append(f'<a href="{study}.html">{picture}<span>{title}</span></a>')
    gallery = "\n".join(["## Studies in pictures\n", '<div class="gallery">', *figures, "</div>"])
    before, heading, after = page.partition("## From Python")
    return f"{before}{gallery}\n\n{heading}{after}"


def _beside(pattern: str) -> list[Path]:
    return sorted(Path(__file__).parent.glob(pattern))


def _with_mathml(html: str, name: str, problems: list[str]) -> str:
    from latex2mathml.converter import convert

    def mathml(match):
        text = unescape(match[2]).strip()
        block = text.startswith("\\[")
        try:
            found = convert(text[2:-2].strip(), display="block" if block else "inline")
            # the names of functions stand apart from their arguments
            return re.sub(r"<mi>(\w\w+)</mi>", r'<mi class="function">\1</mi>', found)
        except Exception as error:  # whatever the converter stumbles over
            problems.append(f"{name}: formula {text}: {type(error).__name__}: {error}")
            return match[0]

    return re.sub(r'<(span|div) class="arithmatex">(.*?)</\1>', mathml, html, flags=re.S)


# ------------------------------------------------------------------------------ links
def _with_site_links(page: str, markdown: str, problems: list[str]) -> str:
    """Links that hold in the repository, as links of the site."""
    source = {page: source for source, page in MOVED.items()}.get(page, f"notebooks/{page}")

    def moved(match):
        before, target, after = match.groups()
        return before + _site_link(source, page, target, problems) + after

    outside = re.split(r"(^```.*?^```$)", markdown, flags=re.M | re.S)
    for i in range(0, len(outside), 2):
        outside[i] = re.sub(r"(\]\()([^)\s]+)(\))", moved, outside[i])
        outside[i] = re.sub(r'(src=")([^"]+)(")', moved, outside[i])
    return "".join(outside)


def _site_link(source, page, target, problems):
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
        problems.append(f"{source}: the site has no page for {target}")
    if path.startswith("reference/") and anchor:
        path = _page_of_anchor(path, anchor)
    link = posixpath.relpath(path, posixpath.dirname(page) or ".")
    return f"{link}#{anchor}" if anchor else link


def _page_of_anchor(path, anchor):
    """The page of the reference that describes a name: one of several of a large module."""
    module = posixpath.basename(path).removesuffix(".md")
    name = anchor.removeprefix(f"{module}.")
    source = public_names().get(module, {}).get(name)
    return path if source is None else _page_of(module, _part_of(module, source))


# ------------------------------------------------------------------------------ notebooks
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


# ------------------------------------------------------------------------------ machine files
def _machines() -> str:
    """Every bundled machine with its file."""
    lines = [
        "# Bundled machines\n",
        "`jaxcomp run NAME` runs one, `jaxcomp new my.toml --from NAME` makes a file to start from, and "
        "`jaxcomp list NAME` shows its values with their sources.\n",
    ]
    for machine in scene.machines():
        text = (ROOT / "jaxcomp" / "machines" / f"{machine.name}.toml").read_text("utf-8")
        lines += [f"## {machine.name}\n", f"{_cell(machine.description)}.\n"]
        lines += [
            f'<details markdown="1"><summary>Its file</summary>\n\n```toml\n{text}```\n\n</details>\n'
        ]
    return "\n".join(lines)


def _entries() -> str:
    """Every entry of a machine file, as `jaxcomp explain` prints it."""
    lines = [
        "# Entries of machine files\n",
        "Every type of part with its entries; `jaxcomp explain TYPE` prints the same. "
        "Numbers are typed with any unit of the dimension of the one that is shown.\n",
    ]
    kinds = dict.fromkeys(places.kind for places in part_places().values())
    for part in (part for kind in kinds for part in explained(kind)):
        places = ", ".join(f"`{place}`" for place in part.places)
        lines += [
            f"## {part.kind} in `{part.places[0]}`\n",
            f"{_cell(part.summary)}. Stands as {places}.\n",
        ]
        if part.entries:
            lines += ["| entry | unit | must be | default | meaning |", "|---|---|---|---|---|"]
        for entry in part.entries:
            default = "required" if entry.required else entry.default
            cells = (f"`{entry.name}`", entry.unit, entry.bound, default, entry.doc)
            lines += [f"| {' | '.join([cells[0], *map(_cell, cells[1:])])} |"]
        lines += [f"\n```toml\n{part.example}\n```\n"]
    return "\n".join(lines)


def _quantities() -> str:
    """Every quantity of a machine by the name that commands take."""
    lines = [
        "# Quantities\n",
        "What `--quantity`, `--objective` and `--constraint` take, and the columns of sweeps; "
        "`jaxcomp list MACHINE --quantities` shows those of a machine.\n",
        "| name | unit | better | meaning |",
        "|---|---|---|---|",
    ]
    for one in registered():
        unit = "%" if one.percent else one.unit
        lines += [f"| `{one.name}` | {unit} | {one.better} | {_cell(one.doc)} |"]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return escape(text, quote=False).replace("|", "\\|")


# ------------------------------------------------------------------------------ reference
def _page_of(module, part=""):
    """The page of a module, or of a part of a large one."""
    return f"reference/{module}{part and f'-{part}'}.md"


def _part_of(module, source):
    """The part of a large module that describes what a file of it holds; "" of other modules."""
    inner = source.removeprefix(f"{module}.")
    for part, files in PARTS.get(module, {}).items():
        if inner.startswith(tuple(files.split()) or ""):
            return part
    return ""


def _entries_of_modules():
    """Modules in the navigation, with their parts below."""
    entries = []
    for module in public_names():
        parts = [{part: _page_of(module, part)} for part in PARTS.get(module, {})]
        pages = [{"overview": _page_of(module)}, *parts]
        entries.append({module: pages if parts else _page_of(module)})
    return entries


def _home(module, name, known):
    """The module whose page describes a name of `jaxcomp` or of a module of the package."""
    if module != "jaxcomp":
        return module
    holders = [other for other, names in known.items() if other != "jaxcomp" and name in names]
    nearest = [other for other in holders if known["jaxcomp"][name].startswith(other)]
    return (nearest or holders or ["jaxcomp"])[0]


def _reference():
    """The index of all public names, and a page or several of each module."""
    known = public_names()
    pages, rows = {}, []
    for module, names in known.items():
        table, described = [], {_page_of(module): []}
        described |= {_page_of(module, part): [] for part in PARTS.get(module, {})}
        for name in sorted(names, key=str.lower):
            home = _home(module, name, known)
            page = _page_of(home, _part_of(home, known[home].get(name, "")))
            told = _cell(first_sentence(names[name], name))
            link = f"[`{name}`]({posixpath.basename(page)}#{home}.{name})"
            table.append(f"| {link} | {told} |")
            if home == module:
                entry = f"::: {module}.{name}\n    options:\n      heading_level: 2\n"
                described[page].append(entry)
                rows.append((name, f"| {link} | `{home}` | {told} |"))
        head = (
            f"::: {module}\n    options:\n      members: false\n      show_root_full_path: true\n"
        )
        head += "      show_source: false\n      heading_level: 1\n"
        listing = "\n".join(["| name | what it is |", "|---|---|", *table])
        for part in PARTS.get(module, {}):
            page = _page_of(module, part)
            pages[page] = f"# {module}: {part}\n\n" + "\n".join(described[page])
        pages[_page_of(module)] = f"{head}\n{listing}\n\n" + "\n".join(described[_page_of(module)])
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


if __name__ == "__main__":
    wrong = finish() if sys.argv[1:] == ["finish"] else write_pages()
    sys.exit("\n".join(wrong) or None)
