"""The API reference: the public functions of the library and the types that they take and give, by mkdocstrings."""

import ast
from pathlib import Path
from typing import Any, Final

_FUNCTIONS: Final = "api.py"
"""The module of the library that holds all public functions."""
_ERRORS: Final = "errors.py"

_SEARCH: Final = "---\nsearch:\n  boost: 0.3\n---\n\n"
"""The search shows documents before pages of the API."""


def public_functions(module: ast.Module) -> list[ast.FunctionDef]:
    """Functions of a module without a leading underscore, in the order of the file."""
    return [node for node in module.body if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")]


def public_types(module: ast.Module, package: str) -> list[str]:
    """Dotted names of the package's types that stand in the signatures of the public functions, sorted by name."""
    imported = {
        alias.name: f"{node.module}.{alias.name}"
        for node in ast.walk(module)
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == package
        for alias in node.names
    }
    annotations = [
        annotation
        for function in public_functions(module)
        for annotation in (function.returns, *(argument.annotation for argument in function.args.args))
        if annotation is not None
    ]
    names = {node.id for annotation in annotations for node in ast.walk(annotation) if isinstance(node, ast.Name)}
    return [imported[name] for name in sorted(names & imported.keys())]


def other_types(face: ast.Module, package: str) -> list[str]:
    """Dotted names of what the top package offers besides its functions and errors."""
    imports = [(node.module or "", node.names) for node in ast.walk(face) if isinstance(node, ast.ImportFrom)]
    inside = [
        (module, names) for module, names in imports if module.startswith(f"{package}.") and module.count(".") > 1
    ]
    return [f"{module}.{alias.name}" for module, names in inside for alias in names]


def _blocks(names: list[str]) -> str:
    return "\n\n".join(f"::: {name}" for name in names)


def _last_word(name: str) -> str:
    return name.rpartition(".")[2]


def api_pages(library: Path) -> dict[str, str]:
    """The pages by their path on the site.

    Args:
        library: Folder of the library's top package.

    Returns:
        A page of the functions, one of the types, and one of the errors.
    """
    package = library.name
    module = ast.parse((library / _FUNCTIONS).read_text(encoding="utf-8"))
    errors = ast.parse((library / _ERRORS).read_text(encoding="utf-8"))
    functions = [f"{package}.api.{function.name}" for function in public_functions(module)]
    face = ast.parse((library / "__init__.py").read_text(encoding="utf-8"))
    types = {*public_types(module, package), *other_types(face, package)}
    classes = [f"{package}.errors.{node.name}" for node in errors.body if isinstance(node, ast.ClassDef)]
    introduction = (
        f"# API reference\n\nThe public functions; `import {package}` offers all of them. [Types](types.md) has what "
        "they take and return, [Errors](errors.md) what they raise. All other modules are private: they can change in "
        "any release.\n\n"
    )
    return {
        "api/index.md": f"{introduction}{_blocks(functions)}\n",
        "api/types.md": f"{_SEARCH}# Types\n\n{_blocks(sorted(types, key=_last_word))}\n",
        "api/errors.md": f"{_SEARCH}# Errors\n\n{_blocks(classes)}\n",
    }


def api_navigation() -> list[Any]:
    """The pages in the order of the navigation."""
    return ["api/index.md", {"Types": "api/types.md"}, {"Errors": "api/errors.md"}]
