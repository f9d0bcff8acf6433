"""Servers that cannot be used: one line, exit code 2, nothing changed there, and nothing hangs."""

import signal
import socket
import subprocess
import sys
import threading
import time

import pytest
from carla_server import play_words
from made_district import district_xodr

from siren_ros.cli.main import main

pytest.importorskip("carla", reason="CARLA's client has no wheel for this machine")

PROGRAM = "import sys; from siren_ros.cli.main import main; sys.exit(main())"
"""As the installed program. With ``-m``, CPython ends by the signal where it comes in a text that ``exec`` runs."""


def played(bag, out, port, capsys):
    code = main([*play_words(bag, port, out), "--timeout-s", "1"])
    told = capsys.readouterr().err.splitlines()
    return code, [line for line in told if line.startswith("siren carla")]


@pytest.fixture
def silent():
    """A port at which something listens that is no CARLA server; it answers every word with the given one."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        words, others = [], []

        def answer():
            while True:
                try:
                    other, _ = listener.accept()
                except OSError:
                    return
                others.append(other)
                if words:
                    other.sendall(words[0])

        threading.Thread(target=answer, daemon=True).start()
        yield listener.getsockname()[1], words
        for other in others:
            other.close()


@pytest.mark.parametrize("word", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\xc1" * 64])
def test_something_else_at_the_port_is_no_server(word, silent, bag, tmp_path, capsys):
    port, words = silent
    words += [word] if word else []
    code, told = played(bag, tmp_path / "out", port, capsys)
    assert (code, len(told)) == (2, 1)
    assert f"127.0.0.1:{port}" in told[0]


def test_nothing_at_the_port_is_told_at_once(bag, tmp_path, capsys):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    code, told = played(bag, tmp_path / "out", port, capsys)
    assert (code, len(told)) == (2, 1)
    assert "HOST:PORT of a running CARLA server" in told[0]


def test_another_version_another_map_and_a_death_at_the_begin(server, bag, tmp_path, capsys):
    before, port = server.get("settings"), server.port()
    for values, word in (
        ({"version": "0.9.13"}, "this one is 0.9.13"),
        ({"version": "0.9.16", "drive": district_xodr()}, "the map of the episode"),
        ({"fault": ("die connecting", 0)}, "a CARLA server that answers"),
    ):
        server.set(**values)
        code, told = played(bag, tmp_path / "out", port, capsys)
        assert (code, len(told)) == (2, 1)
        assert word in told[0]
        assert server.get("settings") == before
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("signal_", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_the_play_and_puts_the_server_back(signal_, code, server, bag, tmp_path):
    server.set(fault=("slow", 0))
    words = play_words(bag, server.port(), tmp_path / "out")
    with subprocess.Popen([sys.executable, "-c", PROGRAM, *words], stderr=subprocess.DEVNULL) as program:
        while len(server.get("history")) < 5 and program.poll() is None:
            time.sleep(0.05)
        program.send_signal(signal_)
        assert program.wait(60.0) == code
    assert not server.get("settings")[0]
    assert {one.kind for one in server.get("actors").values()} == {"traffic.traffic_light"}
    assert not (tmp_path / "out").exists()
