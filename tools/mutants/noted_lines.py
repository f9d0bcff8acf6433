"""Whose lines are whose: what a shared fixture or a test module ran counts for every test that builds on it."""

import ast
import functools
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

_FIXTURE, _MODULE = "fixture ", "module "
_CACHED = type(functools.lru_cache(lambda: None))


class LineNotes:
    """A pytest plugin: says for each line in which test, in whose fixture, or in which test module's import it ran.

    A fixture that several tests share runs within the first of them, and a value that a test module makes while it is
    loaded within none: the line that made it could be noticed by all of them.
    """

    def __init__(self, coverage: Any, package: str) -> None:
        """Take what notes the lines (a ``coverage.Coverage``), and the package whose kept results are forgotten."""
        self._coverage = coverage
        self._package = package
        self._open = [""]
        self._users: dict[str, list[str]] = {}
        self._scopes: dict[str, list[str]] = {}

    @contextmanager
    def _within(self, context: str) -> Iterator[None]:
        self._open.append(context)
        self._coverage.switch_context(context)
        try:
            yield
        finally:
            self._open.pop()
            self._coverage.switch_context(self._open[-1])

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector: pytest.Collector) -> Any:
        """While a test module is loaded its lines are its own."""
        with self._within(_MODULE + collector.nodeid):
            return (yield)

    def pytest_collection_modifyitems(self, items: Sequence[pytest.Item]) -> None:
        """Note the fixtures of each test, the indirect ones too."""
        self._scopes = {item.nodeid: list(getattr(item, "fixturenames", ())) for item in items}

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Any:
        """From here on lines belong to this test, also those whose results an earlier one has kept."""
        forget_results(self._package)
        with self._within(item.nodeid):
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any]) -> Any:
        """What a shared fixture runs belongs to all tests that use it."""
        if fixturedef.scope == "function":
            return (yield)
        base, name = fixturedef.baseid, fixturedef.argname
        context = f"{_FIXTURE}{base}::{name}"
        self._users[context] = [test for test, names in self._scopes.items() if name in names and test.startswith(base)]
        with self._within(context):
            return (yield)

    def tests_by_line(self, file: Path, contexts: Mapping[int, Sequence[str]]) -> dict[int, list[str]]:
        """The tests that can notice a change of each line.

        Args:
            file: The code.
            contexts: By line, where it ran.
        """
        inner = lines_within_functions(file.read_text(encoding="utf-8"))
        found: dict[int, list[str]] = {}
        for line, names in contexts.items():
            tests: set[str] = set()
            for name in names:
                if name in self._scopes:
                    tests.add(name)
                elif name.startswith(_FIXTURE):
                    tests.update(self._users.get(name, ()))
                elif name.startswith(_MODULE) and line in inner:
                    # Other lines ran because it was the first to import the file.
                    module = name.removeprefix(_MODULE)
                    tests.update(test for test in self._scopes if test.startswith(f"{module}::"))
            found[line] = sorted(tests)
        return found


def forget_results(package: str) -> None:
    """Empties the caches of a package's functions: a test that takes a kept result could notice a change as well."""
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] == package:
            for value in list(vars(module).values()):
                if isinstance(value, _CACHED):
                    value.cache_clear()


def lines_within_functions(source: str) -> set[int]:
    """Lines that run when a function is called, and not when the file is imported."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    bodies = [node.body for node in ast.walk(ast.parse(source)) if isinstance(node, functions)]
    return {line for body in bodies for line in range(body[0].lineno, (body[-1].end_lineno or 0) + 1)}
