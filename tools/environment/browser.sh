# shellcheck shell=bash
# A browser for the tests of HTML pages: Debian's Chromium without a display. It comes with the extra `dev`. Where it cannot be had,
# those tests are skipped, so nothing here ends the making of the environment.

BROWSER_PACKAGES=(chromium-headless-shell fonts-dejavu-core)

find_browser() { command -v chromium-headless-shell || command -v chromium || command -v google-chrome; }

# Root installs it. Anyone else, and who runs a system without the package, is told what would be.
install_browser() {
    local line="apt-get install -y --no-install-recommends ${BROWSER_PACKAGES[*]}"
    if ! command -v apt-get >/dev/null || ((EUID != 0)); then
        say "  no Chromium: tests of HTML pages will be skipped. On Debian this brings it: sudo $line"
        return
    fi
    run_step "Debian packages ${BROWSER_PACKAGES[*]}" "$state/browser.log" \
        bash -c "apt-get update && DEBIAN_FRONTEND=noninteractive $line" ||
        say "  no Chromium: tests of HTML pages will be skipped"
}

# Writes down which browser there is, so that ./env notices when a container brings the environment and lacks the browser.
ensure_browser() {
    if [[ " ${extras[*]} " != *" dev "* ]]; then return; fi
    find_browser >/dev/null || install_browser
    find_browser >"$state/browser" || true
}
