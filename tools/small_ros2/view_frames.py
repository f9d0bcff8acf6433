"""``ros2 run tf2_tools view_frames``: the tree of frames as a Graphviz file and as a PDF."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from matplotlib.figure import Figure
from rclpy.utilities import remove_ros_args

from small_ros2.arguments import Parser, not_negative
from small_ros2.errors import CommandError
from small_ros2.ros_graph import observer, spin_until
from small_ros2.transforms import NS_PER_S, FrameTree

AUTHORITY: Final = "default_authority"
"""What tf2's listener calls every broadcaster: DDS does not tell it."""
SHORTEST_S: Final = 0.0001
"""tf2 divides by no shorter time: a static transform has a rate of 10000."""
COLUMN_IN, ROW_IN = 3.2, 1.6


def add_arguments(parser: Parser) -> None:
    """Declares the arguments of the real one."""
    parser.add_argument("--wait-time", "-t", type=not_negative, default=5.0, metavar="S", help="s to listen for (5)")
    parser.add_argument("-o", "--output", help="name of the files (frames_DATE_TIME)")
    parser.add_argument("--tf_topic", default="/tf", help="topic of moving transforms (/tf)")
    parser.add_argument("--tf_static_topic", default="/tf_static", help="topic of static transforms (/tf_static)")


def frame_data(tree: FrameTree) -> dict[str, dict[str, Any]]:
    """What tf2's service ``tf2_frames`` tells of each frame with a parent, with three decimals."""
    data: dict[str, dict[str, Any]] = {}
    for child, link in tree.links.items():
        buffer_s = (link.latest_ns - link.oldest_ns) / NS_PER_S
        data[child] = {
            "parent": link.parent,
            "broadcaster": AUTHORITY,
            "rate": round(len(link.transforms) / max(buffer_s, SHORTEST_S), 3),
            "most_recent_transform": round(link.latest_ns / NS_PER_S, 3),
            "oldest_transform": round(link.oldest_ns / NS_PER_S, 3),
            "buffer_length": round(buffer_s, 3),
        }
    return data


def edge_lines(frame: dict[str, Any]) -> list[str]:
    """What stands beside the arrow from a frame's parent to the frame."""
    return [
        f"Broadcaster: {frame['broadcaster']}",
        f"Average rate: {frame['rate']}",
        f"Buffer length: {frame['buffer_length']}",
        f"Most recent transform: {frame['most_recent_transform']}",
        f"Oldest transform: {frame['oldest_transform']}",
    ]


def roots_of(data: dict[str, dict[str, Any]]) -> list[str]:
    """The frames without a parent, in the order in which they are named."""
    return list(dict.fromkeys(frame["parent"] for frame in data.values() if frame["parent"] not in data))


def dot_text(data: dict[str, dict[str, Any]], recorded_s: float) -> str:
    """The tree in Graphviz' language."""
    if not data:
        return 'digraph G { "No tf data received" }'
    lines = ["digraph G {"]
    for child, frame in data.items():
        label = "".join(f"{line}\\n" for line in edge_lines(frame))
        lines.append(f'"{frame["parent"]}" -> "{child}"[label=" {label}"];')
    lines += [
        "edge [style=invis];",
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";',
        f'"Recorded at time: {recorded_s}"[ shape=plaintext ] ;',
        "}" + "".join(f'->"{root}"' for root in roots_of(data)[:1]) + ";",
        "}",
    ]
    return "\n".join(lines)


def places(data: dict[str, dict[str, Any]]) -> dict[str, tuple[float, int]]:
    """Column and row of each frame: children stand below their parent, in the middle of their own children."""
    cells: dict[str, tuple[float, int]] = {}
    column = 0

    def place(frame: str, row: int) -> float:
        nonlocal column
        cells[frame] = (float(column), row)
        children = [child for child, link in data.items() if link["parent"] == frame and child not in cells]
        columns = [place(child, row + 1) for child in children]
        if not columns:
            columns = [float(column)]
            column += 1
        cells[frame] = ((columns[0] + columns[-1]) / 2.0, row)
        return cells[frame][0]

    for root in roots_of(data):
        place(root, 0)
    return cells


def drawn(data: dict[str, dict[str, Any]], recorded_s: float) -> Figure:
    """The tree as a picture."""
    at = places(data)
    columns = 1 + max((column for column, _ in at.values()), default=0.0)
    rows = 1 + max((row for _, row in at.values()), default=0)
    figure = Figure(figsize=(COLUMN_IN * columns + 1.0, ROW_IN * rows + 1.0))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), frameon=False, xticks=[], yticks=[])
    axes.set_xlim(-0.7, columns - 0.3)
    axes.set_ylim(-rows + 0.4, 1.0)
    title = f"view_frames Result\nRecorded at time: {recorded_s}" if data else "No tf data received"
    axes.text(-0.6, 0.9, title, va="top", fontsize=8, bbox={"boxstyle": "square", "fill": False})
    for child, frame in data.items():
        (to, below), (origin, above) = at.get(child, (0.0, 0)), at.get(frame["parent"], (0.0, 0))
        arrow = {"arrowstyle": "->", "shrinkA": 12.0, "shrinkB": 12.0}
        axes.annotate("", (to, -float(below)), (origin, -float(above)), arrowprops=arrow)
        beside = (to + origin) / 2.0 + 0.03, -(below + above) / 2.0
        axes.text(*beside, "\n".join(edge_lines(frame)), va="center", fontsize=5)
    for name, (column, row) in at.items():
        axes.text(column, -row, name, ha="center", va="center", bbox={"boxstyle": "round", "facecolor": "white"})
    return figure


def main(words: Sequence[str]) -> int:
    """Listens, and writes the two files into the working folder."""
    parser = Parser(prog="view_frames", description="Create a diagram of the TF frames being broadcast over ROS.")
    add_arguments(parser)
    arguments = parser.parse_args(remove_ros_args(["view_frames", *words])[1:])
    tree = FrameTree()
    with observer("view_frames", words) as node:
        tree.listen(node, arguments.tf_topic, arguments.tf_static_topic)
        node.get_logger().info(f"Listening to tf data for {arguments.wait_time} seconds...")
        end_s = time.monotonic() + arguments.wait_time
        spin_until(node, lambda: time.monotonic() >= end_s)
        node.get_logger().info("Generating graph...")
        data, recorded_s = frame_data(tree), node.get_clock().now().nanoseconds / NS_PER_S
        name = arguments.output or f"frames_{time.strftime('%Y-%m-%d_%H.%M.%S')}"
        node.get_logger().info(f"Exporting graph in {name}.pdf file...")
        try:
            Path(f"{name}.gv").write_text(dot_text(data, recorded_s), encoding="utf-8")
            drawn(data, recorded_s).savefig(f"{name}.pdf")
        except OSError as error:
            raise CommandError(f"view_frames: {error}") from error
    return 0
