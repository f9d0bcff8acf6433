#!/usr/bin/env bash
# Builds the workspace with colcon in a scratch folder, twice: as an installation and with --symlink-install, over the
# environment it runs in (./env tools/check_workspace.sh), and checks what came out. Takes a minute or two.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
cd "$root"
export COLCON_DEFAULTS_FILE=$root/colcon_defaults.yaml
mapfile -t nodes < <(find nodes -name '[a-z]*.py' -exec basename {} .py \; | LC_ALL=C sort)

fail() {
    echo "check_workspace: $*" >&2
    exit 1
}

check() { # INSTALL_FOLDER
    local install=$1 name
    local package=$install/siren_ros
    for name in siren "${nodes[@]}"; do
        [[ -x $package/lib/siren_ros/$name ]] || fail "no executable lib/siren_ros/$name"
    done
    [[ -z $(compgen -G "$package/lib/siren_ros/siren-*") ]] || fail "lib/siren_ros has names that pip gives"
    for name in share/siren_ros/package.xml share/siren_ros/launch/cosim.launch.py \
        share/ament_index/resource_index/packages/siren_ros; do
        [[ -e $package/$name ]] || fail "$name is not installed"
    done
    diff <(cd params && find . -type f | LC_ALL=C sort) \
        <(cd "$package/share/siren_ros/params" && find . -type f -o -type l | LC_ALL=C sort) ||
        fail "share/siren_ros/params differs from params/"
    for name in msg_defs/msg/*.msg; do
        [[ -e $install/siren_msgs/share/siren_msgs/msg/$(basename "$name") ]] || fail "$name is not installed"
    done
    # As a user does: source the workspace, ask the index, import, start.
    (
        set +u
        # shellcheck source=/dev/null
        source "$install/local_setup.bash"
        set -u
        cd "$scratch"
        [[ $(ros2 pkg prefix siren_ros) == "$package" ]] || fail "ros2 finds another siren_ros: $(ros2 pkg prefix siren_ros)"
        listing=$(ros2 pkg executables siren_ros)
        for name in "${nodes[@]}"; do
            grep -qx "siren_ros $name" <<<"$listing" || fail "ros2 does not list $name"
        done
        python - "$install" "$2" <<'PYTHON'
import importlib.util, os, pathlib, sys
import siren_msgs.msg, siren_nodes, siren_ros
from siren_ros.base.params.folders import params_dir
install, layout = sys.argv[1:]
assert siren_msgs.__file__.startswith(install), siren_msgs.__file__
if layout == "copied":
    assert siren_ros.__file__.startswith(install), siren_ros.__file__
    assert siren_nodes.__file__.startswith(install), siren_nodes.__file__
    assert str(params_dir()).startswith(install), params_dir()
assert (params_dir() / "templates").is_dir(), params_dir()
PYTHON
        ros2 run siren_ros siren --help >/dev/null || fail "ros2 run siren_ros siren --help fails"
    )
}

for layout in copied symlinked; do
    options=()
    if [[ $layout == symlinked ]]; then options=(--symlink-install); fi
    echo "check_workspace: colcon build ${options[*]}"
    colcon --log-base "$scratch/log_$layout" build --build-base "$scratch/build_$layout" \
        --install-base "$scratch/install_$layout" --event-handlers console_direct- "${options[@]}" </dev/null
    check "$scratch/install_$layout" "$layout"
done
echo "check_workspace: both packages build, install and run"
