"""Reads Python launch files where ROS's package launch is not installed.

The file runs with stand-ins for the parts of ``launch`` and ``launch_ros`` that start nodes with arguments and
parameters. A file that uses any other part is refused with its name.
"""

import json
import runpy
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from small_ros2.errors import CommandError


@dataclass(frozen=True)
class Configuration:
    """``LaunchConfiguration``: the value of an argument."""

    name: str


@dataclass(frozen=True)
class Typed:
    """``ParameterValue``: a value with the type that the parameter has."""

    value: Any
    value_type: Any = None


@dataclass(frozen=True)
class Declared:
    """``DeclareLaunchArgument``."""

    name: str
    default_value: Any = None
    description: str = "no description given"

    @property
    def default(self) -> str | None:
        """The default as text; None where the argument must be given."""
        return None if self.default_value is None else str(self.default_value)


@dataclass(eq=False)
class Started:
    """``Node``: an executable of a package with parameters. ``output`` and ``emulate_tty`` change nothing here."""

    package: str
    executable: str
    name: str | None = None
    namespace: str | None = None
    parameters: list[Any] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    arguments: list[Any] = field(default_factory=list)
    output: str = ""
    emulate_tty: bool = False
    ends_launch: bool = False

    def ros_arguments(self, values: dict[str, str]) -> list[str]:
        """The node's command line behind the executable, with the values of the arguments."""
        words = [str(_resolved(word, values)) for word in self.arguments] + ["--ros-args"]
        if self.name:
            words += ["-r", f"__node:={_resolved(self.name, values)}"]
        if self.namespace:
            words += ["-r", f"__ns:=/{str(_resolved(self.namespace, values)).lstrip('/')}"]
        for source, target in self.remappings:
            words += ["-r", f"{_resolved(source, values)}:={_resolved(target, values)}"]
        for item in self.parameters:
            if isinstance(item, dict):
                for key, value in item.items():
                    words += ["-p", f"{_resolved(key, values)}:={json.dumps(_resolved(value, values))}"]
            else:
                words += ["--params-file", str(_resolved(item, values))]
        return words


@dataclass(frozen=True)
class Description:
    """``LaunchDescription``: the actions in their order."""

    entities: list[Any] = field(default_factory=list)


@dataclass(frozen=True)
class Emitted:
    """``EmitEvent``."""

    event: Any


@dataclass(frozen=True)
class Shutdown:
    """The event that ends the launch."""

    reason: str = ""


@dataclass(frozen=True)
class ProcessExit:
    """``OnProcessExit``: what follows the end of a node."""

    target_action: Started
    on_exit: list[Any] = field(default_factory=list)


@dataclass(frozen=True)
class Registered:
    """``RegisterEventHandler``."""

    event_handler: ProcessExit


STAND_INS: Final[dict[str, dict[str, Any]]] = {
    "launch": {"LaunchDescription": Description},
    "launch.actions": {"DeclareLaunchArgument": Declared, "EmitEvent": Emitted, "RegisterEventHandler": Registered},
    "launch.event_handlers": {"OnProcessExit": ProcessExit},
    "launch.events": {"Shutdown": Shutdown},
    "launch.substitutions": {"LaunchConfiguration": Configuration},
    "launch_ros": {},
    "launch_ros.actions": {"Node": Started},
    "launch_ros.parameter_descriptions": {"ParameterValue": Typed},
}
"""What a launch file may import."""


def _resolved(value: Any, values: dict[str, str]) -> Any:
    if isinstance(value, Configuration):
        if value.name not in values:
            raise CommandError(f"the launch file uses the argument '{value.name}', which has no value")
        return values[value.name]
    if isinstance(value, Typed):
        text = _resolved(value.value, values)
        if value.value_type is bool:
            return str(text).lower() in {"1", "true", "yes", "on"}
        try:
            return value.value_type(text) if value.value_type in {int, float, str} else text
        except ValueError:
            raise CommandError(f"'{text}' is not of the type {value.value_type.__name__}", exit_code=2) from None
    return value


def _stand_in(name: str, members: dict[str, Any]) -> ModuleType:
    module = ModuleType(name)
    vars(module).update(members)

    def missing(member: str) -> Any:
        if member.startswith("__"):
            raise AttributeError(member)
        raise CommandError(f"the launch file uses {name}.{member}; that needs the ros2 of a ROS installation")

    vars(module)["__getattr__"] = missing
    vars(module)["__path__"] = []
    return module


def read_launch_file(path: Path) -> tuple[list[Declared], list[Started]]:
    """The arguments and the nodes of a Python launch file.

    Raises:
        CommandError: The file is of another kind, cannot be run, or uses more than the stand-ins have.
    """
    if path.suffix != ".py":
        raise CommandError(
            f"{path}: only Python launch files are understood here; XML and YAML need a ROS installation"
        )
    known = {name: sys.modules.get(name) for name in STAND_INS}
    sys.modules.update({name: _stand_in(name, members) for name, members in STAND_INS.items()})
    try:
        entities = runpy.run_path(str(path))["generate_launch_description"]().entities
    except CommandError:
        raise
    except (Exception, SystemExit) as error:  # the file is the user's program: anything can happen in it
        raise CommandError(f"{path}: {type(error).__name__}: {error}") from error
    finally:
        for name, module in known.items():
            if module is None:
                del sys.modules[name]
            else:
                sys.modules[name] = module
    for entity in entities:
        if isinstance(entity, Registered) and any(
            isinstance(action, Emitted) and isinstance(action.event, Shutdown)
            for action in entity.event_handler.on_exit
        ):
            entity.event_handler.target_action.ends_launch = True
    declared = [entity for entity in entities if isinstance(entity, Declared)]
    return declared, [entity for entity in entities if isinstance(entity, Started)]
