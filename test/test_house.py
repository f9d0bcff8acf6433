"""What keeps the library small: limits on its size and on habits that make it hard to read, each with its reason.

A limit may only fall. Whoever gets below one by more than a tenth writes the new number here.
"""

import ast
import re
from collections.abc import Collection, Iterator
from functools import cache, reduce
from pathlib import Path
from typing import Final

from repository import REPOSITORY

from docsite.house import grown, recorded_sizes, sizes_of
from siren_ros.simulation.scenario import driver_parameters
from siren_ros.simulation.scenario.scenario import VARIETY

LIBRARY: Final = REPOSITORY / "siren_ros"
GROWTH: Final = 0.03
"""A wing may grow by this share of its lines without a word. More is a decision, which the changelog explains."""
MOST_TOP_FOLDERS: Final = 9
"""A reader has to keep them in mind all at once: eight wings and the command line."""
MOST_CLASSES: Final = 900
"""Each class is a word that a reader has to learn."""
FEW_LINES: Final = 60
SMALL_FILES: Final = frozenset(
    [
        "base/numerics/units.py",
        "lab/benchmarks/study_sizes.py",
        "running/studies/ready_worker.py",
    ]
)
"""Files with fewer lines. A concept that is so small is a part of a neighbour, where a reader finds it."""
MOST_NUMBERED_COLUMNS: Final = 4
"""``values[3, row]`` in compiled code does not say what column 3 is; ``values[SPEED, row]`` does."""
MOST_ANY: Final = 3
"""``Any`` in the signature of a compiled function: a reader does not see what it takes, and mypy checks nothing."""
MOST_PRIVATE_NAMES: Final = 1
"""Private names in tests: such a test fails when the code is arranged in another way, although it behaves the same."""
NOT_SET: Final = frozenset(
    f"{config}.{name}"
    for config, names in {
        "FilmFitConfig": "batch clip_frames epochs focus frame_weight near_steps steps thresholds",
        "FitConfig": (
            "architecture averaging batch device epochs first_weight layers probability_weight share_of_all width"
        ),
        "LockstepConfig": (
            "close_timeout_s display_names late_close_timeout_s outside participants start_timeout_s "
            "step_timeout_s steps trailing"
        ),
        "SceneConfig": (
            "building_height_m building_setback_m clearance_m dash_gap_m dash_m ground_margin_m kerb_height_m "
            "kerb_width_m lamp_height_m lamp_spacing_m line_width_m open_country_m rail_spacing_m "
            "road_extension_m skyline_m solid_before_junction_m stop_line_depth_m tile_m tree_spacing_m "
            "verge_width_m zebra_depth_m zebra_stripe_m"
        ),
    }.items()
    for name in names.split()
)
"""Fields of configs that no user can set. A number that nobody sets is a constant beside the law that uses it."""
THEIR_NAMES: Final = frozenset(["_replace", "_asdict", "_fields", "_exit", "_repr_html_"])
"""Names that are public where they come from: named tuples, the operating system, notebooks."""


def private_names(tree: ast.Module) -> Iterator[str]:
    """Private names of other files that a test imports, uses or replaces."""
    nodes = list(ast.walk(tree))
    own = {node.name for node in nodes if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    for node in nodes:
        match node:
            case ast.Attribute(value=ast.Name(id="self" | "cls"), attr=name):
                own.add(name)
    for node in nodes:
        match node:
            case ast.Attribute(attr=name):
                names = [name]
            case ast.ImportFrom(names=aliases):
                names = [alias.name for alias in aliases]
            case ast.Call(func=ast.Attribute(attr="setattr"), args=arguments):
                texts = [node.value for node in arguments if isinstance(node, ast.Constant)]
                names = [text.rpartition(".")[2] for text in texts if isinstance(text, str)]
            case _:
                names = []
        yield from (name for name in names if re.match(r"_[^_]", name) and name not in own | THEIR_NAMES)


def fields_not_set(tree: ast.Module) -> Iterator[str]:
    """Fields of a file's config classes that are declared without what a user has to know to set them."""
    for kind in tree.body:
        if isinstance(kind, ast.ClassDef) and kind.name.endswith("Config"):
            for part in kind.body:
                match part:
                    case ast.AnnAssign(value=ast.Call(func=ast.Name(id="parameter" | "number"))):
                        pass
                    case ast.AnnAssign(target=ast.Name(id=name)):
                        yield f"{kind.name}.{name}"


@cache
def compiled_functions() -> list[ast.FunctionDef]:
    """The functions that numba compiles (``siren_ros/base/numerics/compiled.py``)."""
    texts = (path.read_text(encoding="utf-8") for path in LIBRARY.rglob("*.py"))
    trees = (ast.parse(text) for text in texts if "@compiled" in text)
    return [function for tree in trees for function in compiled_in(tree)]


def compiled_in(tree: ast.Module) -> list[ast.FunctionDef]:
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and "compiled" in map(ast.unparse, node.decorator_list)
    ]


def numbered_columns(function: ast.FunctionDef) -> int:
    """How often a function takes a column of a table by a number: a literal among several indices."""
    places = (node.slice for node in ast.walk(function) if isinstance(node, ast.Subscript))
    tables = (place.elts for place in places if isinstance(place, ast.Tuple) and len(place.elts) > 1)
    return sum(any(isinstance(index, ast.Constant) and isinstance(index.value, int) for index in one) for one in tables)


def any_in_signature(function: ast.FunctionDef) -> int:
    """How often the signature of a function says ``Any``."""
    given = [argument.annotation for argument in (*function.args.args, *function.args.kwonlyargs)]
    parts = [node for part in (*given, function.returns) if part is not None for node in ast.walk(part)]
    return sum(isinstance(part, ast.Name) and part.id == "Any" for part in parts)


def assert_within(count: int, limit: int) -> None:
    """Holds a count to a limit that may only fall."""
    assert count <= limit
    assert count > 0.9 * limit, f"write {count} in place of {limit}: what was gained shall stay"


def small_files(library: Path) -> set[str]:
    return {
        path.relative_to(library).as_posix()
        for path in library.rglob("*.py")
        if path.name != "__init__.py" and path.read_text(encoding="utf-8").count("\n") < FEW_LINES
    }


def unexplained(growth: Collection[str], changelog: str) -> list[str]:
    """Wings that have grown and that the unreleased part of a changelog does not name."""
    unreleased = changelog.split("\n## ")[1]
    return [name for name in growth if f"wing `{name}`" not in unreleased]


def test_a_wing_that_grows_much_says_why() -> None:
    growth = grown(sizes_of(LIBRARY), recorded_sizes(REPOSITORY / "docs" / "sizes.json"), GROWTH)
    silent = unexplained(growth, (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8"))
    assert silent == [], f"say in CHANGELOG.md why the wing grows, with the words 'wing `{silent[0]}`'"


def test_the_library_has_few_folders_at_its_top() -> None:
    assert len(sizes_of(LIBRARY)) <= MOST_TOP_FOLDERS


def test_the_library_has_no_more_classes() -> None:
    assert_within(sum(size.classes for size in sizes_of(LIBRARY).values()), MOST_CLASSES)


def test_no_more_files_are_small() -> None:
    small = small_files(LIBRARY)
    assert small - SMALL_FILES == set(), "put what they hold where its concept lives"
    assert_within(len(small), len(SMALL_FILES))


def test_compiled_code_takes_no_more_columns_by_number() -> None:
    assert_within(sum(map(numbered_columns, compiled_functions())), MOST_NUMBERED_COLUMNS)


def test_no_more_compiled_signatures_say_any() -> None:
    assert_within(sum(map(any_in_signature, compiled_functions())), MOST_ANY)


def test_a_config_holds_what_users_can_set() -> None:
    """Fields of ``SceneConfig`` with the names of the variety come from templates."""
    texts = (path.read_text(encoding="utf-8") for path in sorted(LIBRARY.rglob("*.py")))
    found = {name for text in texts if "Config" in text for name in fields_not_set(ast.parse(text))}
    found -= {f"SceneConfig.{path.rpartition('.')[2]}" for path in VARIETY}
    assert found - NOT_SET == set(), "make them parameters, or constants beside the law that uses them"
    assert NOT_SET - found == set(), "leave them out of the list: what was gained shall stay"


def test_every_number_of_drivers_has_a_name_for_users() -> None:
    """A class of parameters that stands nowhere in the tree would have fields that nobody reaches."""
    tree = ast.parse(Path(driver_parameters.__file__).read_text(encoding="utf-8"))
    declared = {
        (kind.name, ast.unparse(part.target))
        for kind in tree.body
        if isinstance(kind, ast.ClassDef)
        for part in kind.body
        if isinstance(part, ast.AnnAssign) and isinstance(part.value, ast.Call) and "number(" in ast.unparse(part.value)
    }
    reached = set()
    for name in driver_parameters.DRIVER_PARAMETERS:
        *path, last = name.split(".")
        owner = reduce(getattr, path, driver_parameters.DriverParameters())
        reached.add((type(owner).__name__, last))
    assert reached == declared


def test_tests_know_no_more_private_names() -> None:
    texts = (path.read_text(encoding="utf-8") for path in sorted((REPOSITORY / "test").rglob("*.py")))
    trees = (ast.parse(text) for text in texts if re.search(r"""[\s.'"]_[A-Za-z]""", text))
    assert_within(sum(1 for tree in trees for _ in private_names(tree)), MOST_PRIVATE_NAMES)
