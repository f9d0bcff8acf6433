"""The claim to a DDS domain: one holder at a time on a machine, given back however the holder ends."""

import subprocess
import sys

import pytest

from siren_ros.errors import InputError
from siren_ros.ros.transport.domain import VARIABLE, claimed_domain

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="abstract sockets are Linux's")
HOLD = """
from siren_ros.ros.transport.domain import claimed_domain
with claimed_domain():
    print("held", flush=True)
    input()
"""


def test_a_domain_is_claimed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "101")
    refusal = pytest.raises(InputError, match=r"another one runs here already .*ROS_DOMAIN_ID=0")
    with claimed_domain(), refusal, claimed_domain():
        pytest.fail("claimed twice")
    with claimed_domain():
        pass


def test_two_domains_are_two_claims(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "100")
    with claimed_domain():
        monkeypatch.setenv(VARIABLE, "101")
        with claimed_domain():
            for number in ("100", "101"):
                monkeypatch.setenv(VARIABLE, number)
                with pytest.raises(InputError), claimed_domain():
                    pytest.fail("claimed twice")


def test_a_killed_holder_leaves_no_claim(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "99")
    with subprocess.Popen([sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(InputError), claimed_domain():
            pytest.fail("claimed twice")
        holder.kill()
        holder.wait()
    with claimed_domain():
        pass
