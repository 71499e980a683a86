"""The links of built pages, and what they load."""

import re
from html.parser import HTMLParser
from urllib.parse import unquote


class Page(HTMLParser):
    """What a built page links to, what it loads, and its anchors."""

    def __init__(self, text):
        super().__init__()
        self.links, self.loads, self.anchors = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.anchors |= {given.get("id"), given.get("name") if tag == "a" else None} - {None}
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        loaded = given.get("src") or (given.get("href") if tag == "link" else None)
        if loaded and given.get("rel") != "canonical":
            self.loads.append(loaded)


def broken(site):
    """What is wrong with the links of a built site, and with what its pages load."""
    pages = {path: Page(path.read_text("utf-8")) for path in site.rglob("*.html")}
    for path, page in pages.items():
        name = path.relative_to(site)
        if name.name == "404.html":  # its links begin at the root of a server
            continue
        for target in page.loads:
            if re.match(r"(https?:)?//", target):
                yield f"{name} loads {target}"
        for target in page.links + page.loads:
            if re.match(r"([a-z]+:|//)", target):
                continue
            file, _, anchor = target.partition("#")
            there = (path.parent / unquote(file.partition("?")[0])).resolve() if file else path
            there = there / "index.html" if there.is_dir() else there
            if not there.exists():
                yield f"{name}: {target} leads to no file"
            elif anchor and there in pages and unquote(anchor) not in pages[there].anchors:
                yield f"{name}: {target} leads to no heading"
    for sheet in site.rglob("*.css"):
        for target in re.findall(r"url\(['\"]?((?:https?:)?//[^)'\"]*)", sheet.read_text("utf-8")):
            yield f"{sheet.relative_to(site)} loads {target}"
