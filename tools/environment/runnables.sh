# shellcheck shell=bash
# What `ros2 run` finds in the environment, and the variables that ./env sets.

# The executables of siren_ros and the entries of the ament index, where colcon would put them; and the small ros2 where no real one
# is. pip has put the executables into bin/, under names that begin with the project's.
install_runnables() {
    local name node executables=$venv/lib/siren_ros index=$venv/share/ament_index/resource_index/packages
    mkdir -p "$executables" "$index" "$venv/share/siren_ros"
    find "$executables" -mindepth 1 -delete
    entry_points | while IFS= read -r name; do
        node=${name#siren-}
        ln -sfn "../../bin/$name" "$executables/${node//-/_}"
    done
    : >"$index/siren_ros"
    ln -sfn "$root/package.xml" "$venv/share/siren_ros/package.xml"
    ln -sfn "$root/params" "$venv/share/siren_ros/params"
    # A folder of links: `ros2 launch` does not follow links to folders.
    rm -rf "$venv/share/siren_ros/launch"
    mkdir "$venv/share/siren_ros/launch"
    ln -s "$root"/launch/*.launch.* "$venv/share/siren_ros/launch/"
    if [[ $ros == wheels ]]; then
        write_small_ros2
        # sensor_msgs_py and rosidl_runtime_py, which PyPI lacks.
        printf '%s\n' "$root/tools/environment/python" >"$(compgen -G "$venv/lib/python3.*/site-packages")/siren_ros_python.pth"
    fi
    write_variables
}

entry_points() {
    sed -n '/^\[console_scripts\]/,/^\[/s/^\([A-Za-z_][A-Za-z0-9_-]*\) *=.*/\1/p' \
        "$venv"/lib/python3.*/site-packages/siren_ros-*.dist-info/entry_points.txt
}

write_small_ros2() {
    cat >"$venv/bin/ros2.new" <<SCRIPT
#!$venv/bin/python
import sys

sys.path.insert(0, "$root/tools")
from small_ros2.main import main

sys.exit(main(sys.argv[1:]))
SCRIPT
    chmod +x "$venv/bin/ros2.new"
    mv -f "$venv/bin/ros2.new" "$venv/bin/ros2"
}

# What ./env sources. The ROS wheels set LD_LIBRARY_PATH by starting every Python twice; setting it here saves the second start.
write_variables() {
    local libraries=$venv/lib folder site
    site=$(compgen -G "$venv/lib/python3.*/site-packages")
    for folder in "$site"/ros_*.libs; do
        if [[ -d $folder ]]; then libraries+=:$folder; fi
    done
    {
        echo "# Written by ./env, which sources it before the command runs; so does a colcon workspace that was built over it."
        cat <<'POSIX'
_siren_prepend() {
    eval "set -- \"\$1\" \"\$2\" \"\${$1-}\""
    case ":$3:" in *":$2:"*) ;; *) export "$1=$2${3:+:$3}" ;; esac
}
_siren_append() {
    eval "set -- \"\$1\" \"\$2\" \"\${$1-}\""
    case ":$3:" in *":$2:"*) ;; *) export "$1=${3:+$3:}$2" ;; esac
}
POSIX
        printf 'export VIRTUAL_ENV=%q\n' "$venv"
        printf '_siren_prepend PATH %q\n' "$venv/bin"
        printf '_siren_append AMENT_PREFIX_PATH %q\n' "$venv"
        printf '_siren_append CMAKE_PREFIX_PATH %q\n' "$venv"
        printf '_siren_prepend LD_LIBRARY_PATH %q\n' "$libraries"
        if [[ $ros == wheels ]]; then
            echo 'export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1'
        else
            # The installation's own ros2 runs under the system's Python and has to find siren_msgs.
            printf '_siren_append PYTHONPATH %q\n' "$site"
        fi
        echo 'export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE-LOCALHOST}"'
        echo 'if [ -z "${FASTRTPS_DEFAULT_PROFILES_FILE-}${FASTDDS_DEFAULT_PROFILES_FILE-}" ]; then'
        # Sockets on the loopback interface while discovery stays on this machine (siren_ros/running/ros/transport/dds.py).
        echo '    case "$ROS_AUTOMATIC_DISCOVERY_RANGE:${ROS_STATIC_PEERS-}" in'
        printf '        :* | NOT_SET:* | SUBNET:* | SYSTEM_DEFAULT:* | *:?*) export FASTRTPS_DEFAULT_PROFILES_FILE=%q ;;\n' \
            "$root/params/fastdds.xml"
        printf '        *) export FASTRTPS_DEFAULT_PROFILES_FILE=%q ;;\n' "$root/params/fastdds_localhost.xml"
        echo '    esac'
        echo 'fi'
        # Where compiled Python may not lie beside the sources, as in many containers, each start would compile everything anew.
        echo 'if [ -n "${PYTHONDONTWRITEBYTECODE-}" ] && [ -z "${PYTHONPYCACHEPREFIX-}" ]; then'
        printf '    unset PYTHONDONTWRITEBYTECODE\n    export PYTHONPYCACHEPREFIX=%q\n' "$venv/pycache"
        echo 'fi'
        printf 'export COLCON_DEFAULTS_FILE="${COLCON_DEFAULTS_FILE-%s}"\n' "$root/colcon_defaults.yaml"
        echo 'unset -f _siren_prepend _siren_append'
    } >"$state/environment.sh.new"
    mv -f "$state/environment.sh.new" "$state/environment.sh"
    # The names under which colcon looks for the setup of a prefix that a workspace is built over.
    ln -sfn .siren/environment.sh "$venv/local_setup.sh"
    ln -sfn .siren/environment.sh "$venv/local_setup.bash"
}
