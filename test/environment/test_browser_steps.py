"""The browser for the tests of pages: who gets it, and what happens where it cannot be had."""

import os
from pathlib import Path

import pytest
from environment_support import Checkout, run_shell

NO_BROWSER = 'find_browser() { return 1; }; run_step() { shift 2; echo "$*"; return ${FAILS-0}; };'


def test_an_environment_without_dev_gets_no_browser(tmp_path: Path) -> None:
    assert run_shell(NO_BROWSER + "mkdir -p $state; extras=(models); ensure_browser; ls $state", tmp_path).stdout == ""


@pytest.mark.skipif(os.geteuid() != 0, reason="only root installs packages of the system")
@pytest.mark.parametrize("fails", ["0", "100"])
def test_root_installs_it_and_goes_on_where_that_fails(tmp_path: Path, fails: str) -> None:
    script = NO_BROWSER + "mkdir -p $state; apt-get() { :; }; extras=(dev models); ensure_browser; echo went on"
    result = run_shell(script, tmp_path, FAILS=fails)
    assert "install -y --no-install-recommends chromium-headless-shell" in result.stdout
    assert result.stdout.endswith("\nwent on\n")
    assert ("will be skipped" in result.stderr) == (fails == "100")


def test_without_root_the_line_is_said_and_all_goes_on(tmp_path: Path) -> None:
    script = NO_BROWSER + "apt-get() { :; }; extras=(dev); ensure_browser; echo went on"
    result = run_shell(script, tmp_path, user="nobody" if os.geteuid() == 0 else None)
    assert result.stdout == "went on\n"
    assert "sudo apt-get install -y --no-install-recommends chromium-headless-shell" in result.stderr


def test_what_is_found_is_written_down(tmp_path: Path) -> None:
    script = "mkdir -p $state; find_browser() { echo /usr/bin/one; }; extras=(dev); ensure_browser; cat $state/browser"
    assert run_shell(script, tmp_path).stdout == "/usr/bin/one\n"


@pytest.mark.parametrize(("browser", "calls"), [("", 1), ("/bin/true\n", 1), ("/no/such/browser\n", 2)])
def test_a_machine_that_lost_the_browser_gets_it_again(checkout: Checkout, browser: str, calls: int) -> None:
    checkout.env("true")
    (checkout.root / ".venv/.siren/browser").write_text(browser)
    checkout.env("true")
    assert len(checkout.calls()) == calls
