"""The pages of the site, for MkDocs: the repository's, declarations, and what they link to.

A link leads where it leads on GitHub. A linked file that is neither page nor picture becomes a page
that shows it, as a browser would only save it.
"""

import json
import posixpath
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

LINK = re.compile(r"(?<=\]\()[^)#:\s]+")
LANGUAGES = {
    ".py": "python",
    ".json": "json",
    ".lua": "lua",
    ".toml": "toml",
    ".yml": "yaml",
    ".cff": "yaml",
    "": "text",
}
PICTURES = {".png", ".svg", ".webp"}
RECORDING = ".cast"  # of a terminal
PLAYER = "asciinema-player"
MADE = {  # pages that a module prints
    "docs/options.md": "views.reference",
    "docs/messages.md": "views.message_reference",
    "docs/api.md": "views.api_reference",
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Return the theme's files, the pages of the navigation, and what these link to."""
    root = Path(config.config_file_path).parent
    pages = list(named(config.nav))
    there = [page for page in pages if page not in MADE]
    linked = {link for page in there for link in links(page, (root / page).read_text())}
    found = [file for file in files if file.src_dir != config.docs_dir]
    found += [File.generated(config, page, abs_src_path=str(root / page)) for page in there]
    found += [File.generated(config, page, content=made(MADE[page], root)) for page in MADE]
    # A page that is not in the navigation is missed: MkDocs then says so.
    others = sorted(name for name in linked - set(pages) if not name.endswith(".md"))
    if any(name.endswith(RECORDING) for name in others):
        assets = resources.files("mkdocs_asciinema_player") / "assets"
        for name in (f"{PLAYER}.min.js", f"{PLAYER}.css"):
            found.append(File.generated(config, name, content=(assets / name).read_bytes()))
    found += [linked_file(config, root, name) for name in others if (root / name).is_file()]
    return Files(found)


def made(module: str, root: Path) -> str:
    command = [sys.executable, "-m", module]
    return subprocess.run(command, cwd=root, check=True, stdout=subprocess.PIPE, text=True).stdout


def linked_file(config: MkDocsConfig, root: Path, name: str) -> File:
    """Return a picture as it is, and any other file as a page that shows it."""
    if Path(name).suffix in PICTURES:
        return File.generated(config, name, abs_src_path=str(root / name))
    inclusion, text = InclusionLevel.NOT_IN_NAV, (root / name).read_text()
    is_recording = Path(name).suffix == RECORDING
    content = played(text, "../" * name.count("/")) if is_recording else shown(root / name)
    return File.generated(config, f"{name}.md", content=content, inclusion=inclusion)


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links to files that are shown lead to the pages that show them."""

    def led(link: "re.Match[str]") -> str:
        there = beside(page.file.src_uri, link[0])
        return f"{link[0]}.md" if f"{there}.md" in files.src_uris else link[0]

    return LINK.sub(led, markdown)


def named(part: Any) -> Iterator[str]:
    """Yield the paths in a part of the navigation."""
    if isinstance(part, str):
        yield part
    else:
        for inner in part.values() if isinstance(part, dict) else part:
            yield from named(inner)


def links(page: str, text: str) -> set[str]:
    """Return the files of the repository that a page links to."""
    return {beside(page, link) for link in LINK.findall(text)}


def beside(page: str, link: str) -> str:
    """Return the path of what a page links to."""
    return posixpath.normpath(posixpath.join(posixpath.dirname(page), link))


def shown(file: Path) -> str:
    """Return a page that shows a file; of a notebook, its cells."""
    if file.suffix == ".ipynb":
        cells = json.loads(file.read_text())["cells"]
        return "\n\n".join(shown_cell(cell["cell_type"], "".join(cell["source"])) for cell in cells)
    return f"# {file.name}\n\n{fenced(LANGUAGES[file.suffix], file.read_text())}"


def played(recording: str, top: str) -> str:
    """Return a page that plays a recording in asciinema's format, also where no server is."""
    title = json.loads(recording.partition("\n")[0])["title"]
    data = json.dumps(recording).replace("<", "\\u003c")
    return f"""# {title}

<link rel="stylesheet" href="{top}{PLAYER}.css">
<div id="{PLAYER}"></div>
<script src="{top}{PLAYER}.min.js"></script>
<script>
AsciinemaPlayer.create(
    {{data: {data}}}, document.getElementById("{PLAYER}"), {{poster: "npt:0:30"}})
</script>
"""


def shown_cell(kind: str, source: str) -> str:
    """Return a cell of a notebook as Markdown."""
    return fenced("python", source) if kind == "code" else source


def fenced(language: str, text: str) -> str:
    """Return text as a block; its fence is longer than those within."""
    return f"``````{language}\n{text.rstrip()}\n``````"
