"""While discovery stays on this machine, nobody on a network gets into an episode's domain."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from dds_domains import own_domain
from program_output import next_line, own_lines
from repository import REPOSITORY

from siren_ros.ros.transport.fastdds_profile import (
    LOOPBACK,
    NETWORK,
    choose_profile,
    discovery_as_in_profile,
    profile_name,
)

PARAMS = REPOSITORY / "params"
INSIDE_IP, OUTSIDE_IP = "10.213.77.1", "10.213.77.2"

TALKER = """
import rclpy
from rclpy.node import Node
from siren_ros.ros.programs.program import start_ros
from std_msgs.msg import String
start_ros()
node = Node("inside")
publisher = node.create_publisher(String, "/inside", 1)
print("ready", flush=True)
rclpy.spin(node)
"""
LISTENER = """
import sys, time
import rclpy
from rclpy.node import Node
rclpy.init()
node = Node("outside")
end_s = time.monotonic() + float(sys.argv[1])
while not node.count_publishers("/inside") and time.monotonic() < end_s:
    time.sleep(0.05)
print("found" if node.count_publishers("/inside") else "nobody")
"""


@pytest.mark.parametrize(
    ("variables", "name"),
    [
        ({}, NETWORK),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, NETWORK),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, LOOPBACK),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, LOOPBACK),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": "10.0.0.1"}, NETWORK),
    ],
)
def test_the_range_decides(variables: dict[str, str], name: str) -> None:
    assert profile_name(variables) == name


def test_our_profile_follows_the_range_and_a_users_own_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(PARAMS / LOOPBACK))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    choose_profile()
    assert Path(os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"]).name == NETWORK
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", "/my/own.xml")
    choose_profile()
    assert os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] == "/my/own.xml"


def test_the_profiles_differ_in_interfaces_and_peers_alone() -> None:
    limited, network = ((PARAMS / name).read_text(encoding="utf-8").split("-->")[1] for name in (LOOPBACK, NETWORK))
    for start, end, holds in (
        ("        <interfaceWhiteList>\n", "</interfaceWhiteList>\n", "<address>127.0.0.1</address>"),
        ("        <maxInitialPeersRange>", "</maxInitialPeersRange>\n", "32"),
        ("          <metatrafficUnicastLocatorList>\n", "</metatrafficUnicastLocatorList>\n", "<locator/>"),
        ("          <initialPeersList>\n", "</initialPeersList>\n", "<address>127.0.0.1</address>"),
    ):
        before, rest = limited.split(start)
        part, after = rest.split(end)
        assert holds in part
        assert part.count("<address>") == holds.count("<address>")
        limited = before + after
    assert limited == network


SOCKETS = """
import os
from pathlib import Path
from rclpy.node import Node
from siren_ros.ros.programs.program import start_ros
start_ros()
node = Node("quiet")
own = {os.readlink(entry) for entry in Path("/proc/self/fd").iterdir() if entry.is_symlink()}
for table in ("udp", "udp6"):
    for line in Path("/proc/self/net", table).read_text().splitlines()[1:]:
        words = line.split()
        if f"socket:[{words[9]}]" in own:
            print(table, words[1].split(":")[0], flush=True)
print(os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"], flush=True)
"""


@pytest.mark.timeout(60)
@pytest.mark.parametrize("discovery", ["LOCALHOST", "SUBNET"])
def test_while_discovery_stays_here_every_udp_socket_is_on_the_loopback_interface(discovery: str) -> None:
    """Those that only send, too. What the program starts finds the range that the user chose."""
    pytest.importorskip("rclpy", reason="needs ROS")
    clean = {name: value for name, value in os.environ.items() if "PROFILES_FILE" not in name}
    variables = {**clean, "ROS_DOMAIN_ID": str(own_domain()), "ROS_AUTOMATIC_DISCOVERY_RANGE": discovery}
    run = subprocess.run([sys.executable, "-c", SOCKETS], env=variables, capture_output=True, text=True, check=True)
    *sockets, inherited = own_lines(run.stdout).splitlines()
    assert inherited == discovery
    assert len(sockets) >= 3
    if discovery == "LOCALHOST":
        assert set(sockets) == {"udp 0100007F"}
    else:
        assert "udp 00000000" in sockets


def test_only_the_range_of_this_machine_is_left_to_the_profile(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rclpy", reason="needs ROS")
    monkeypatch.delenv("FASTDDS_DEFAULT_PROFILES_FILE", raising=False)
    variable = "ROS_AUTOMATIC_DISCOVERY_RANGE"
    for profile, given, during in (
        (str(PARAMS / LOOPBACK), "LOCALHOST", "SYSTEM_DEFAULT"),
        (str(PARAMS / LOOPBACK), "OFF", "OFF"),
        (str(PARAMS / NETWORK), "LOCALHOST", "LOCALHOST"),
        ("/my/own.xml", "LOCALHOST", "LOCALHOST"),
        ("", "LOCALHOST", "LOCALHOST"),
    ):
        monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", profile)
        monkeypatch.setenv(variable, given)
        with discovery_as_in_profile():
            assert os.environ[variable] == during
        assert os.environ[variable] == given


@pytest.fixture(scope="module", name="networks")
def _networks() -> Iterator[tuple[str, str]]:
    """Two network namespaces with a cable between them."""
    inside, outside = (f"siren-{side}-{os.getpid()}" for side in ("in", "out"))
    ends = (f"sin{os.getpid()}"[:15], f"sout{os.getpid()}"[:15])
    commands = [f"netns add {inside}", f"netns add {outside}", f"link add {ends[0]} type veth peer name {ends[1]}"]
    for name, end, address in ((inside, ends[0], INSIDE_IP), (outside, ends[1], OUTSIDE_IP)):
        commands += [f"link set {end} netns {name}", f"-n {name} addr add {address}/24 dev {end}"]
        commands += [f"-n {name} link set {end} up", f"-n {name} link set lo up"]
    if shutil.which("ip") is None:
        pytest.skip("needs the command ip")
    try:
        for command in commands:
            done = subprocess.run(["ip", *command.split()], capture_output=True, text=True, check=False)
            if done.returncode:
                pytest.skip(f"network namespaces cannot be made here: {done.stderr.strip()}")
        yield inside, outside
    finally:
        for name in (inside, outside):
            subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)


@pytest.mark.timeout(120)
@pytest.mark.parametrize(("discovery", "answer"), [("SUBNET", "found"), ("LOCALHOST", "nobody")])
def test_a_stranger_that_names_this_machine_joins_only_an_open_range(
    networks: tuple[str, str], discovery: str, answer: str
) -> None:
    pytest.importorskip("rclpy", reason="needs ROS")
    clean = {name: value for name, value in os.environ.items() if "PROFILES_FILE" not in name}
    common = {**clean, "ROS_DOMAIN_ID": str(own_domain())}
    inside = {**common, "ROS_AUTOMATIC_DISCOVERY_RANGE": discovery}
    outside = {**common, "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_STATIC_PEERS": INSIDE_IP}
    outside["FASTDDS_BUILTIN_TRANSPORTS"] = "UDPv4"  # not the shared memory of this machine
    words = [["ip", "netns", "exec", network, sys.executable, "-c"] for network in networks]
    talker = subprocess.Popen([*words[0], TALKER], env=inside, stdout=subprocess.PIPE, text=True)
    try:
        assert next_line(talker.stdout) == "ready\n"
        patience_s = "30" if answer == "found" else "8"
        heard = subprocess.run(
            [*words[1], LISTENER, patience_s], env=outside, capture_output=True, text=True, check=True, timeout=60
        )
    finally:
        talker.kill()
        talker.communicate()
    assert heard.stdout.strip() == answer
