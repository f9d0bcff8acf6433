"""Classes of messages, services and actions by the names of their types."""

from importlib import import_module
from typing import Any


def get_interface(identifier: str) -> Any:
    """The class of a type such as ``std_msgs/msg/String``.

    Raises:
        ValueError: The name is not of the form ``package/kind/Name``.
        ModuleNotFoundError, AttributeError: The package is not installed, or lacks the type.
    """
    parts = identifier.split("/")
    if len(parts) != 3 or not all(parts):
        raise ValueError(f"Invalid name '{identifier}'. Expected three parts separated by '/'")
    package, kind, name = parts
    return getattr(import_module(f"{package}.{kind}"), name)


def _of_kind(identifier: str, kind: str) -> Any:
    parts = identifier.split("/")
    if len(parts) == 2:
        parts.insert(1, kind)
    if len(parts) != 3 or parts[1] != kind:
        raise ValueError(f"Expected the full name of a {kind}, got '{identifier}'")
    return get_interface("/".join(parts))


def get_message(identifier: str) -> Any:
    """The class of a message; ``std_msgs/String`` is understood too. Errors: ``get_interface``."""
    return _of_kind(identifier, "msg")


def get_service(identifier: str) -> Any:
    """The class of a service. Errors: ``get_interface``."""
    return _of_kind(identifier, "srv")


def get_action(identifier: str) -> Any:
    """The class of an action. Errors: ``get_interface``."""
    return _of_kind(identifier, "action")
