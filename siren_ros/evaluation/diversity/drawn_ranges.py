"""Between what seeds draw the parameters of a template."""

from collections.abc import Iterable

from siren_ros.errors import SirenError
from siren_ros.evaluation.diversity.parameter_coverage import DrawnRange
from siren_ros.evaluation.diversity.profile import InteractionProfile
from siren_ros.scenario.templates import load_template


def drawn_ranges(profiles: Iterable[InteractionProfile]) -> dict[str, dict[str, DrawnRange]]:
    """By template and parameter; a template that is not among ours has none.

    Episodes whose values a study drew have the template's whole ranges; the others those that every seed draws from.
    """
    by_template: dict[str, list[InteractionProfile]] = {}
    for profile in profiles:
        by_template.setdefault(profile.template, []).append(profile)
    found: dict[str, dict[str, DrawnRange]] = {}
    for name, members in by_template.items():
        try:
            template = load_template(name)
        except SirenError:
            continue
        limits = template.ranges if any(one.draw for one in members) else template.drawn
        found[name] = {path: DrawnRange(one.minimum, one.maximum, one.integer) for path, one in limits.items()}
    return found
