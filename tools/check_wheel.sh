#!/usr/bin/env bash
# Builds the wheel and uses it as somebody without the repository does: in fresh environments outside of the checkout, with every
# CPython 3.11 and 3.12 of this machine, and with numpy 1 and numpy 2. A wheel that works is left in dist/.
#
#   ./env tools/check_wheel.sh [--tests]
#
# --tests   also runs the tests of folders that depend most on numpy, against the wheel with numpy 2
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
ros=wheels
# shellcheck source=environment/system.sh
source "$root/tools/environment/system.sh"
TESTED_FOLDERS=(numerics recording sensors conflicts)
TEST_PACKAGES=(pytest pytest-timeout pytest-xdist hypothesis playwright open3d)

say() { echo "check_wheel: $*"; }

uv() { python "$root/tools/environment/uv_like_pip.py" "$@"; }

# Nothing of the environment that this script runs in reaches the program.
apart() { env -i PATH=/usr/bin:/bin HOME="$scratch" LANG=C.UTF-8 "$@"; }

build_wheel() {
    # From a copy, because setuptools leaves its build folder beside the sources.
    mkdir "$scratch/source"
    (cd "$root" && git ls-files -z --cached --others --exclude-standard | xargs -0 cp --parents -t "$scratch/source" 2>/dev/null || true)
    python -m pip wheel --quiet --no-deps --wheel-dir "$scratch/wheel" "$scratch/source"
    wheel=$(compgen -G "$scratch/wheel/siren_ros-*.whl")
    say "built $(basename "$wheel")"
}

# The first interpreter of each supported version.
interpreters() {
    local candidate version seen=" "
    while IFS= read -r candidate; do
        candidate=$(probe_python "$candidate") || continue
        version=$("$candidate" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
        if [[ $seen != *" $version "* ]]; then
            seen+="$version "
            echo "$candidate"
        fi
    done < <(python_candidates)
}

use() { # ENVIRONMENT: the library and the command, from a folder of their own; what they print is shown where one fails
    local siren=$1/bin/siren work=$1/work
    mkdir "$work"
    cp "$root/examples/library.py" "$work/"
    cd "$work"
    if ! {
        apart "$1/bin/python" -W error::ImportWarning library.py &&
            apart "$siren" --version &&
            apart "$siren" generate --templates S2 S6 --seeds 0 --duration-s 40 --workers 1 --out study &&
            apart "$siren" info study/episodes/S2_L2/S2_L2_seed0 &&
            apart "$siren" verify study/episodes/S2_L2/S2_L2_seed0 &&
            apart "$siren" evaluate prediction study --models cv,siren --workers 1 &&
            apart "$siren" evaluate yield study &&
            apart "$siren" export openpcdet bag --out openpcdet &&
            apart "$siren" plot bag --out plot.png &&
            apart "$siren" export html bag --out episode.html &&
            apart "$siren" report study --out report.html &&
            apart "$siren" train --help &&
            [[ -s report.html ]]
    } >log 2>&1; then
        cat log >&2
        return 1
    fi
    cd "$root"
}

check() { # PYTHON NUMPY
    local environment bound
    environment=$scratch/$(basename "$1")_$2
    uv venv --quiet --python "$1" "$environment"
    if [[ $2 == numpy1 ]]; then bound='numpy<2'; else bound='numpy>=2'; fi
    uv pip install --quiet --python "$environment/bin/python" "$wheel" "$bound"
    say "$("$environment/bin/python" -c 'import platform, numpy; print("Python", platform.python_version(), "numpy", numpy.__version__)')"
    use "$environment" || exit 1
    if [[ $2 == numpy2 && $tests == yes ]]; then
        uv pip install --quiet --python "$environment/bin/python" "${TEST_PACKAGES[@]}" "$bound"
        (cd "$root" && apart "$environment/bin/pytest" -n 0 -q -p no:cacheprovider "${TESTED_FOLDERS[@]/#/test/}")
    fi
}

tests=no
if [[ ${1-} == --tests ]]; then tests=yes; fi
build_wheel
mapfile -t pythons < <(interpreters)
if ((${#pythons[@]} == 0)); then
    say "no CPython 3.11 or 3.12 was found" >&2
    exit 1
fi
for python in "${pythons[@]}"; do
    for numpy in numpy1 numpy2; do check "$python" "$numpy"; done
done
mkdir -p "$root/dist"
cp "$wheel" "$root/dist/"
say "the wheel works: dist/$(basename "$wheel")"
