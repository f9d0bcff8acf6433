#!/usr/bin/env bash
# Writes tools/environment/lock.txt: one exact version of every package that pyproject.toml, with all extras, and ros_wheels.txt lead to,
# for Linux with CPython 3.11 and 3.12. Versions of the present lock stay where the ranges allow them. It also writes the hashes of the
# files of these versions: hashes.txt, and uv.txt for uv.
#
#   ./env tools/update_lock.sh                  after a change of the ranges
#   ./env tools/update_lock.sh --upgrade        takes the newest versions
#   ./env tools/update_lock.sh -P scipy         takes the newest version of one package
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")/environment" && pwd)
cd "$here/../.."
# Without an index, a header and paths: the lock names packages and versions only, whatever machine writes it. It is resolved for the
# older Python; the newer one installs the same versions.
python "$here/uv_like_pip.py" pip compile --quiet --python-version 3.11 --python-platform x86_64-manylinux_2_35 --all-extras \
    --override "$here/overrides.txt" --output-file "$here/lock.txt" --no-header --no-annotate \
    --no-emit-index-url --no-emit-find-links --no-emit-package siren-ros "$@" pyproject.toml "$here/ros_wheels.txt"
# A build of a package for one machine, as 2.1+cpu, is another file of the same version.
sed -i 's/^\([^ ;]*==[^ ;+]*\)+[^ ;]*/\1/' "$here/lock.txt"

# PyPI itself, whatever pip is configured for: a mirror may lack files of other machines. torch has builds of its own for each kind of
# machine, which other indexes serve under the same version: without a hash, all can be installed.
pypi_hashes() { # FILE: of exact versions; writes hashes to the output
    env -u UV_INDEX -u UV_DEFAULT_INDEX -u UV_FIND_LINKS -u UV_NO_INDEX uv --no-config pip compile --quiet --generate-hashes \
        --python-version 3.11 --python-platform x86_64-manylinux_2_35 --no-deps --no-header --no-annotate "$1"
}
pypi_hashes <(grep -v '^torch==' "$here/lock.txt") >"$here/hashes.txt"
pypi_hashes <(grep -o '^uv==[^ ]*' "$here/uv.txt") >"$here/uv.txt.new"
mv "$here/uv.txt.new" "$here/uv.txt"
