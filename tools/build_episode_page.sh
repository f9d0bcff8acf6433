#!/usr/bin/env bash
# Builds the script of an episode's page from web/episode_page: checks the types, runs the tests that need no browser, bundles
# it with three.js, and writes params/pages/episode/page.js. Needs Node.js 18 or later with npm, which root installs from Debian where they are missing, and a
# network where the packages are not in npm's cache. The versions are those of package-lock.json.
#
#   tools/build_episode_page.sh            write the file
#   tools/build_episode_page.sh --check    fail where the file in the repository is not what the sources give
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
target=$root/params/pages/episode/page.js
cd "$root/web/episode_page"

if ! command -v npm >/dev/null; then
    install="apt-get install -y --no-install-recommends nodejs npm"
    if ((EUID != 0)); then
        echo "build_episode_page: needs Node.js and npm: sudo $install" >&2
        exit 1
    fi
    apt-get update -qq
    $install
fi

npm ci --no-audit --no-fund --ignore-scripts --loglevel=error
npx --no-install tsc
npx --no-install esbuild test/logic.test.ts --bundle --platform=node --log-level=warning | node --test-reporter=dot - >&2
built=$(mktemp --suffix .js)
trap 'rm -f "$built"' EXIT
npx --no-install esbuild src/main.ts --bundle --minify --format=iife --target=es2022 --charset=utf8 --legal-comments=none \
    --banner:js="$(printf '/*! three.js\n%s\n*/' "$(cat node_modules/three/LICENSE)")" --log-level=warning --outfile="$built" --allow-overwrite
if [[ ${1-} == --check ]]; then
    cmp "$built" "$target" || {
        echo "build_episode_page: run tools/build_episode_page.sh and commit $target" >&2
        exit 1
    }
else
    install -m 644 "$built" "$target"
    echo "build_episode_page: $(wc -c <"$target") bytes in ${target#"$root"/}"
fi
