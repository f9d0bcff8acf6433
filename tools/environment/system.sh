# shellcheck shell=bash
# What the environment needs from the machine: a Python, a C++ compiler, shared libraries.

# --- Debian packages --------------------------------------------------------------------------------------------------

has_library() { compgen -G "/usr/lib/*-linux-gnu/$1" >/dev/null || ldconfig -p 2>/dev/null | grep -qF "$1 "; }

has_software_gl() {
    local drivers
    for drivers in /usr/lib/*-linux-gnu/dri/swrast_dri.so /usr/lib/*-linux-gnu/libgallium*.so /usr/lib64/dri/swrast_dri.so; do
        [[ -e $drivers ]] && return 0
    done
    return 1
}

# Debian's names of what is missing. Open3D needs libusb, GL, EGL and OpenMP, SUMO needs X11's libraries, the cameras need a GL
# driver (Mesa's, beside that of a GPU), the message packages a C++ compiler.
missing_packages() {
    has_library libusb-1.0.so.0 || echo libusb-1.0-0
    has_library libGL.so.1 || echo libgl1
    has_library libEGL.so.1 || echo libegl1
    has_library libgomp.so.1 || echo libgomp1
    has_library libX11.so.6 || echo libx11-6
    has_library libXext.so.6 || echo libxext6
    has_library libXrender.so.1 || echo libxrender1
    has_software_gl || echo libgl1-mesa-dri
    command -v g++ >/dev/null || echo g++
    if [[ -z ${SIREN_PYTHON-} ]] && ! usable_python >/dev/null; then missing_python; fi
}

# The system's own Python where it has a version that fits: python3.12 on Ubuntu 24.04, python3.11 on Debian 12.
missing_python() {
    local version=3.11
    if command -v apt-cache >/dev/null && apt-cache show python3.12 >/dev/null 2>&1; then version=3.12; fi
    printf '%s\n' "python$version" "python$version-dev" "python$version-venv"
}

# Debian has the packages: root installs them, anyone else is told the line. Other systems are told what is missing.
ensure_system_packages() {
    local packages
    mapfile -t packages < <(missing_packages)
    if ((${#packages[@]} == 0)); then return; fi
    if ! command -v apt-get >/dev/null; then
        say "missing on this system (Debian's names): ${packages[*]}"
        exit 1
    fi
    if ((EUID != 0)); then
        say "packages of the system are missing; install them with this line, then run the command again:"
        echo "sudo apt-get update && sudo apt-get install -y --no-install-recommends ${packages[*]}" >&2
        exit 1
    fi
    run_step "apt-get update" "$venv.apt.log" apt-get update
    mapfile -t packages < <(missing_packages) # which Python there is shows only now
    run_step "Debian packages ${packages[*]}" "$venv.apt.log" \
        env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${packages[@]}"
    rm -f "$venv.apt.log"
}

# --- Python -----------------------------------------------------------------------------------------------------------

# Prints the real path of a usable interpreter: CPython 3.11 or 3.12 that can make environments and has its C headers, and that
# imports rclpy where a ROS is sourced. The path is the base interpreter's, also where the candidate belongs to an environment.
probe_python() { # CANDIDATE
    "$1" - "$ros" 2>/dev/null <<'PYTHON'
import os, sys, sysconfig
if sys.implementation.name != "cpython" or sys.version_info[:2] not in ((3, 11), (3, 12)):
    raise SystemExit(1)
import ensurepip, venv
if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
    raise SystemExit(1)
if sys.argv[1] == "sourced":
    import rclpy
print(os.path.realpath(getattr(sys, "_base_executable", sys.executable)))
PYTHON
}

python_candidates() {
    local pyenv=${PYENV_ROOT:-${HOME-}/.pyenv}
    type -aP python3.12 python3.11 python3 2>/dev/null || true
    compgen -G "$pyenv/versions/3.12*/bin/python3.12" || true
    compgen -G "$pyenv/versions/3.11*/bin/python3.11" || true
}

usable_python() {
    local candidate
    if [[ -n ${SIREN_PYTHON-} ]]; then
        probe_python "$SIREN_PYTHON"
        return
    fi
    while IFS= read -r candidate; do
        if probe_python "$candidate"; then return 0; fi
    done < <(python_candidates)
    return 1
}

find_python() { # sets $python
    if python=$(usable_python); then return; fi
    if [[ -n ${SIREN_PYTHON-} ]]; then
        say "SIREN_PYTHON: '$SIREN_PYTHON' cannot be used; allowed: a CPython 3.11 or 3.12 with venv and C headers"
        exit 2
    fi
    say "no CPython 3.11 or 3.12 with venv and C headers was found; name one with SIREN_PYTHON=PATH"
    exit 1
}

sourced_ros_has() { # PACKAGE
    local prefix
    local -a prefixes
    IFS=: read -r -a prefixes <<<"${AMENT_PREFIX_PATH-}"
    for prefix in "${prefixes[@]}"; do
        if [[ $prefix != "$venv" && -e $prefix/share/$1/package.xml ]]; then return 0; fi
    done
    return 1
}
