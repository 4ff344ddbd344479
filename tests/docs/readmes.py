"""The READMEs as data: their blocks, links and headings.

A block is fenced code. A comment in the line before it, which no reader sees, says how to test it:
  <!-- not run: WHY -->     shell: only that commands, options and files exist
  <!-- slow: WHY -->        shell: run by the nightly part alone
  <!-- not loaded: WHY -->  TOML: only parsed
  <!-- in: finger -->       TOML: stands in a [[finger]] of a scene
  <!-- with FILE -->        TOML: stands beside what this scene has
  <!-- file: NAME -->       TOML: a file of this name that others refer to
  <!-- output -->           what the shell lines before it print, among other things
"""
import pathlib
import re
from dataclasses import dataclass

ROOT = pathlib.Path(__file__).resolve().parents[2]


@dataclass
class Block:
    file: pathlib.Path
    line: int
    language: str
    mark: str  # "not run", "not loaded", "slow", "in", "with", "file", "output"; empty: none
    mark_value: str
    text: str

    def __str__(self):
        return f"{self.file.relative_to(ROOT)}:{self.line}"


def readmes():
    return [ROOT / "README.md"] + sorted(ROOT.glob("*/README.md")) + [ROOT / "scenes/api/README.md"]


def blocks(file):
    found, start, mark = [], None, ("", "")
    lines = file.read_text().splitlines()
    for number, line in enumerate(lines, 1):
        if start is None and line.startswith("```"):
            comment = re.fullmatch(r"<!-- (not run|not loaded|slow|in|with|file|output):? ?(.*?) -->", lines[number - 2].strip())
            mark = (comment[1], comment[2]) if comment else ("", "")
            start, language = number, line[3:].strip()
        elif start is not None and line.startswith("```"):
            found.append(Block(file, start, language, *mark, "\n".join(lines[start : number - 1]) + "\n"))
            start = None
    assert start is None, f"{file}:{start}: the block does not end"
    return found


def all_blocks(language):
    return [b for f in readmes() for b in blocks(f) if b.language == language]


def prose(file):
    """The text without its blocks."""
    return re.sub(r"^```.*?^```", "", file.read_text(), flags=re.M | re.S)


def anchors(file):
    """As GitHub and GitLab name headings."""
    titles = re.findall(r"^#+ (.*)$", prose(file), flags=re.M)
    return {re.sub(r"[^\w\- ]", "", t.lower()).replace(" ", "-") for t in titles}


def shell_commands(block):
    """(line, command) of a block; a backslash or an open quote joins lines, a comment ends one."""
    text, number = "", block.line
    for line in block.text.splitlines():
        number += 1
        text += line
        if text.endswith("\\"):
            text = text[:-1]
            continue
        if text.count('"') % 2:
            text += "\n"
            continue
        if text.split("#")[0].strip():
            yield number, text.strip()
        text = ""
