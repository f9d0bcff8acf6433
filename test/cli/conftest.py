import os
import sys

import pytest

from siren_ros.cli.main import main


@pytest.fixture
def siren(capsys):
    """Runs a command line that ends with an exit code, and gives what it printed."""

    def run(words, code=0):
        assert main(words) == code
        return capsys.readouterr()

    return run


@pytest.fixture
def becomes(monkeypatch):
    """Runs a command line that becomes another program, and gives that one's words."""

    def run(words):
        became = []
        monkeypatch.setattr(os, "execv", lambda _, arguments: became.extend(arguments) or sys.exit(0))
        with pytest.raises(SystemExit):
            main(words)
        return became

    return run
