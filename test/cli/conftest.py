import pytest

from siren_ros.cli.main import main


@pytest.fixture
def siren(capsys):
    """Runs a command line that ends with an exit code, and gives what it printed."""

    def run(words, code=0):
        assert main(words) == code
        return capsys.readouterr()

    return run
