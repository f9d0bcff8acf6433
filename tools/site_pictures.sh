#!/usr/bin/env bash
# Makes the pictures and films of the documents again, from the first two seeds of every template: ./env tools/site_pictures.sh
set -euo pipefail
tools=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
siren generate --seeds 0:2 --out "$work/study"
PYTHONPATH=$tools${PYTHONPATH:+:$PYTHONPATH} python -m docsite.pictures "$work/study" "$tools/../docs"
