"""One episode under `ros2 launch siren_ros cosim.launch.py template:=S2`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

# The parameters that an episode is most often told; every other one of cosim's is set with a parameter file.
ARGUMENTS = (
    ("template", str, "S2", "interaction template, S1 to S8"),
    ("level", str, "", "emergency level, L0 to L3, or 0 to 3; empty: the template's own"),
    ("seed", int, "0", "seed of every random stream"),
    ("map", str, "", "SUMO net, OpenDRIVE or OpenStreetMap file, town, city or motorway; empty: the template's own"),
)


def generate_launch_description() -> LaunchDescription:
    """Declares the arguments, starts cosim with them and ends with it."""
    cosim = Node(
        package="siren_ros",
        executable="cosim",
        output="screen",
        emulate_tty=True,
        parameters=[
            {name: ParameterValue(LaunchConfiguration(name), value_type=kind) for name, kind, _, _ in ARGUMENTS}
        ],
    )
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=description)
                for name, _, default, description in ARGUMENTS
            ),
            cosim,
            RegisterEventHandler(OnProcessExit(target_action=cosim, on_exit=[EmitEvent(event=Shutdown())])),
        ]
    )
