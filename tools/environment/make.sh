#!/usr/bin/env bash
# Makes or mends the project's environment; called by ./env, which holds the lock.
#
#   make.sh ROOT VENV wheels|sourced KEY [EXTRA...]
#
# Steps that are done are skipped, so an interrupted run is taken up where it stopped. KEY, the key of everything that defines the
# environment, goes into the last stamp, the one that ./env compares. Each EXTRA of pyproject.toml is added to those that are installed.
set -euo pipefail

root=$1
venv=$2
ros=$3
key=$4
shift 4
asked_extras=("$@")
state=$venv/.siren
here=$root/tools/environment
# shellcheck source=progress.sh
source "$here/progress.sh"
# shellcheck source=system.sh
source "$here/system.sh"
# shellcheck source=browser.sh
source "$here/browser.sh"
# shellcheck source=steps.sh
source "$here/steps.sh"
# shellcheck source=runnables.sh
source "$here/runnables.sh"

verify() {
    run_step "check: everything imports" "$state/verify.log" \
        bash -c 'source "$1" && exec "$2" -c "$3"' bash "$state/environment.sh" "$venv/bin/python" \
        'import rclpy, siren_msgs.msg, tf2_msgs.msg, vision_msgs.msg, rosbag2_interfaces.srv, sensor_msgs.msg
import libsumo, moderngl, rosbags, scipy, siren_ros, siren_nodes'
}

# The compiler makes the message packages while wheels and the browser are still downloaded and unpacked, and while the library's loops
# are compiled.
make_all() {
    local packages browser status=0
    cd "$root"
    make_venv
    collect_extras # sets $extras
    install_ros
    (trap - INT && install_packages && compile_loops) &
    packages=$!
    (trap - INT && ensure_browser) &
    browser=$!
    build_messages || status=$?
    wait "$packages" || status=$?
    wait "$browser" || status=$?
    chmod -f go-w "$venv/.lock" || true # uv lets everybody write it
    if ((status)); then exit "$status"; fi
    install_runnables
}

start=$SECONDS
say "making the environment in ${venv#"$root"/}"
rm -f "$state/complete"
ensure_system_packages
make_all
if ! verify; then
    if ((fresh)); then
        say "the new environment does not work; the log is $state/verify.log"
        exit 1
    fi
    say "the environment is damaged; making it anew"
    rm -rf "$venv"
    make_all
    verify
fi
printf '%s\n' "${extras[@]}" >"$state/extras.new"
mv -f "$state/extras.new" "$state/extras"
printf '%s\n' "$key" >"$state/complete.new"
mv -f "$state/complete.new" "$state/complete"
say "environment ready after $((SECONDS - start)) s"
