#!/usr/bin/env bash
# Changes the code in small ways and looks whether the tests notice: ./env tools/mutants.sh --help
set -euo pipefail
PYTHONPATH=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)${PYTHONPATH:+:$PYTHONPATH} exec python -m mutants "$@"
