"""The pages a reader sees, and what is in them: blocks of code, commands, links."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = {
    str(file.relative_to(ROOT)): file
    for file in (ROOT / "README.md", *sorted(DOCS.glob("*.md")), *sorted(DOCS.glob("*/*.md")))
}
FENCE = re.compile(r"^```(?P<language>\w*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
LANGUAGES = ("sh", "python", "toml", "json", "text")


class Block(NamedTuple):
    """A fenced block: what it is in, and what it holds."""

    language: str
    body: str


def read_page(page: str) -> str:
    return PAGES[page].read_text(encoding="utf-8")


def list_blocks(text: str, *languages: str) -> list[Block]:
    """The fenced blocks of a page, in these languages."""
    found = [Block(one["language"], one["body"]) for one in FENCE.finditer(text)]
    return [one for one in found if not languages or one.language in languages]


def list_commands(text: str) -> list[list[str]]:
    """The words of every command in the page's `sh` blocks, in order; lines may go on with a backslash."""
    commands = []
    for block in list_blocks(text, "sh"):
        for line in block.body.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            while "&&" in words:
                cut = words.index("&&")
                commands.append(words[:cut])
                words = words[cut + 1 :]
            commands.append(words)
    return [words for words in commands if words]


def list_mentions(text: str) -> list[list[str]]:
    """Commands that the prose names in code spans: `toolkit print --board`, `make test`."""
    prose = FENCE.sub("", text)
    spans = re.findall(r"`((?:toolkit|make) [^`]+)`", prose)
    return [shlex.split(one) for one in spans]
