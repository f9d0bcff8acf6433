#!/usr/bin/env bash
# Makes the pictures and films of the documents again, from the first two seeds of every template: ./env tools/site_pictures.sh
# With names of templates only theirs: ./env tools/site_pictures.sh S1 S5 (the sensors' pictures need S1 and S2)
set -euo pipefail
tools=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
if (($# == 0)); then set -- S1 S2 S3 S4 S5 S6 S7; fi
siren generate --templates "$@" --seeds 0:2 --out "$work/study"
PYTHONPATH=$tools${PYTHONPATH:+:$PYTHONPATH} python -m docsite.pictures "$work/study" "$tools/../docs"
