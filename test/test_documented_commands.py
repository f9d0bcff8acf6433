"""Commands in the documents: every verb, option, node and parameter that they name exists."""

import ast
import re
import shlex
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Final

import pytest
from repository import REPOSITORY

from siren_ros.cli.main import command_lines
from siren_ros.running.ros import node_configs
from siren_ros.running.ros.parameters import defaults_of

DOCUMENTS: Final = sorted([*REPOSITORY.glob("*.md"), *(REPOSITORY / "docs").rglob("*.md")])
LINES: Final = {line.prog: line for line in command_lines()}
CONFIGS: Final = {
    re.sub(r"(?<!^)(?=[A-Z])", "_", name.removesuffix("Config")).lower(): config
    for name, config in vars(node_configs).items()
    if isinstance(config, type) and name.endswith("Config")
}


def commands(markdown: str) -> Iterator[list[str]]:
    """The words of each command in code blocks and between backticks, without ./env and what it takes."""
    blocks = re.findall(r"^```.*?\n(.*?)^```", markdown, re.MULTILINE | re.DOTALL)
    indented = re.findall(r"(?:^ {4}.*\n?)+", markdown, re.MULTILINE)
    inline = re.findall(r"`([^`\n]+)`", markdown)
    joined = [text.replace("\\\n", " ") for text in (*blocks, *indented)]
    for line in (*(line for text in joined for line in text.splitlines()), *inline):
        try:
            words = shlex.split(line, comments=True)
        except ValueError:
            continue
        while words and (words[0] == "./env" or re.fullmatch(r"[A-Z_]+=.*", words[0])):
            words = words[1:]
        while words[:1] == ["--with"]:
            words = words[2:]
        if words:
            yield words


def faults_of(words: list[str]) -> Iterator[str]:
    """What a command names that does not exist."""
    if words[0] == "siren" and len(words) > 1 and re.fullmatch(r"[a-z][a-z0-9-]*", words[1]):
        yield from _faults_of_siren(words)
    elif words[:3] == ["ros2", "run", "siren_ros"] and len(words) > 3 and re.fullmatch("[a-z_]+", words[3]):
        yield from _faults_of_node(words[3], words[4:])
    elif words[0] in {"python", "bash"} and len(words) > 1 and words[1].startswith("examples/"):
        yield from (f"{words[1]} does not exist" for _ in "x" if not (REPOSITORY / words[1]).is_file())


def _faults_of_siren(words: list[str]) -> Iterator[str]:
    prog = "siren"
    rest = words[1:]
    while rest and f"{prog} {rest[0]}" in LINES:
        prog, rest = f"{prog} {rest[0]}", rest[1:]
    if prog == "siren":
        yield f"siren has no command {words[1]}"
        return
    if set(LINES[prog].below()) - set(LINES[prog].variants.values()) and rest and not rest[0].startswith("-"):
        if re.fullmatch(r"[a-z][a-z0-9-]*", rest[0]):
            yield f"{prog} has no {rest[0]}"
        return  # FORMAT or TASK stands for any of them
    known = {option for action in LINES[prog].arguments() for option in action.option_strings}
    for option in (word.partition("=")[0] for word in rest if word.startswith("--")):
        if option not in known:
            yield f"{prog} has no option {option}"


def _faults_of_node(node: str, words: list[str]) -> Iterator[str]:
    if node == "NODE":
        return
    if node not in CONFIGS:
        yield f"there is no node {node}"
        return
    known = defaults_of(CONFIGS[node])
    for name in (word.partition(":=")[0] for word in words if ":=" in word):
        if name not in known:
            yield f"{node} has no parameter {name}"


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_commands_in_documents_exist(path: Path) -> None:
    assert not [fault for words in commands(path.read_text(encoding="utf-8")) for fault in faults_of(words)]


@pytest.mark.parametrize("path", sorted((REPOSITORY / "examples").glob("*.sh")), ids=lambda path: path.name)
def test_commands_in_example_scripts_exist(path: Path) -> None:
    listed = list(commands(f"```\n{path.read_text(encoding='utf-8')}```\n"))
    assert [words for words in listed if words[0] == "siren"]
    assert not [fault for words in listed for fault in faults_of(words)]


def missing_names(markdown: str) -> list[str]:
    """What Python blocks import from the library that is not there."""
    blocks = re.findall(r"^```python\n(.*?)^```", markdown, re.MULTILINE | re.DOTALL)
    imports = [node for block in blocks for node in ast.walk(ast.parse(block)) if isinstance(node, ast.ImportFrom)]
    ours = [
        (node.module, name.name) for node in imports if (node.module or "").startswith("siren_") for name in node.names
    ]
    return [f"{module}.{name}" for module, name in ours if not hasattr(import_module(str(module)), name)]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_names_that_documents_import_exist(path: Path) -> None:
    assert missing_names(path.read_text(encoding="utf-8")) == []
