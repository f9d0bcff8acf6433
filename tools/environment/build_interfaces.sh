#!/usr/bin/env bash
# Builds one interface package with the real rosidl pipeline and installs it into a virtual environment.
#
#   build_interfaces.sh VENV SOURCE_FOLDER wheels|sourced
#
# Over the wheels only what rclpy with Fast DDS loads is made; a sourced ROS may run other middleware and C++ programs, and gets
# everything.
# The build folder stays in the environment, so that building again after a changed .msg takes seconds. Files of messages that
# are gone are removed.
set -euo pipefail

venv=$(cd "$1" && pwd)
source_dir=$(cd "$2" && pwd)
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
package=$(sed -n 's/.*<name>\(.*\)<\/name>.*/\1/p' "$source_dir/package.xml")
state=$venv/.siren
build=$state/build/$package
mkdir -p "$build"

export PATH="$venv/bin:$PATH"
export AMENT_PREFIX_PATH="$venv${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}"
export CMAKE_PREFIX_PATH="$venv${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}"

generator=()
if command -v ninja >/dev/null; then generator=(-G Ninja); fi

generators=()
if [[ $3 == wheels ]]; then generators=("-Drosidl_default_generators_DIR=$here"); fi

cmake --fresh -S "$source_dir" -B "$build" "${generator[@]}" \
    -DCMAKE_INSTALL_PREFIX="$venv" -DPython3_EXECUTABLE="$venv/bin/python" -DBUILD_TESTING=OFF \
    "${generators[@]}"
cmake --build "$build"
cmake --install "$build" | sed '/^-- Up-to-date:/d'

# What the last build installed and this one did not is gone from the package.
manifest=$state/$package.manifest
sort -u "$build/install_manifest.txt" >"$manifest.new"
if [[ -f $manifest ]]; then
    comm -23 "$manifest" "$manifest.new" | while IFS= read -r gone; do rm -f -- "$gone"; done
fi
mv -f "$manifest.new" "$manifest"
