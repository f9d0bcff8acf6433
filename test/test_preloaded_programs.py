"""A program that begins in a copy of a loaded process looks like one that was executed."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from preloaded_programs import PreloadedProgram

LOOK = """
import json, os, sys
from pathlib import Path
me = Path("/proc/self")
print(json.dumps({
    "parent": os.getppid(), "arguments": sys.argv, "folder": os.getcwd(), "session": os.getsid(0) == os.getpid(),
    "threads": len(list((me / "task").iterdir())), "open": len(list((me / "fd").iterdir())), "name": __name__,
    "variables": dict(os.environ), "command": (me / "cmdline").read_text().rstrip(chr(0)).split(chr(0)),
    "at_start": sorted((me / "environ").read_text().rstrip(chr(0)).split(chr(0))), "said": sys.stdin.readline(),
}))
"""
KINDS = (subprocess.Popen, PreloadedProgram)


@pytest.mark.parametrize("new_session", [False, True])
def test_it_is_what_an_executed_program_is(new_session: bool, tmp_path: Path) -> None:
    variables = {**os.environ, "MARK": "mine"}
    seen = []
    for start in KINDS:
        with start(
            [sys.executable, "-c", LOOK, "a", "b c"],
            env=variables,
            cwd=tmp_path,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=new_session,
            text=True,
        ) as program:
            seen.append(json.loads(program.communicate("hello\n", timeout=60.0)[0]))
        assert program.returncode == 0
    executed, copied = seen
    assert copied == executed
    assert (copied["parent"], copied["variables"]["MARK"], copied["said"]) == (os.getpid(), "mine", "hello\n")


@pytest.mark.parametrize(
    ("text", "code", "last"),
    [
        ("import sys; sys.exit(3)", 3, ""),
        ("import sys; sys.exit('bad')", 1, "bad"),
        ("1 / 0", 1, "ZeroDivisionError: division by zero"),
        ("import os; os.kill(os.getpid(), 9)", -signal.SIGKILL, ""),
        ("import atexit, sys; atexit.register(lambda: print('over', file=sys.stderr))", 0, "over"),
    ],
)
def test_it_ends_as_python_ends(text: str, code: int, last: str) -> None:
    for start in KINDS:
        with start([sys.executable, "-c", text], stderr=subprocess.PIPE, text=True) as program:
            err = program.communicate(timeout=60.0)[1]
        assert (program.returncode, (err.splitlines() or [""])[-1]) == (code, last)


def test_it_runs_modules_and_files(tmp_path: Path) -> None:
    (tmp_path / "beside.py").write_text("VALUE = 4", encoding="utf-8")
    (tmp_path / "program.py").write_text("import beside, sys; print(__name__, beside.VALUE, sys.argv[1])")
    for words in (["-m", "program", "x"], [str(tmp_path / "program.py"), "x"]):
        with PreloadedProgram([sys.executable, *words], cwd=tmp_path, stdout=subprocess.PIPE, text=True) as program:
            assert program.communicate(timeout=60.0)[0] == "__main__ 4 x\n"


def test_ctrl_c_reaches_it() -> None:
    text = "import time; print('ready', flush=True); time.sleep(60)"
    command = [sys.executable, "-c", text]
    with PreloadedProgram(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n"
        program.send_signal(signal.SIGINT)
        assert program.communicate(timeout=60.0)[1].splitlines()[-1] == "KeyboardInterrupt"
    assert program.returncode == -signal.SIGINT
