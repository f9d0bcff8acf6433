"""A study whose process dies before any of its writes goes on as if it had not."""

import subprocess
import sys

PROGRAM = """
import os, sys, tempfile
from pathlib import Path
from siren_ros.running.studies.episode_row import EpisodeRow, Status
from siren_ros.running.studies.matrix import Study
from siren_ros.running.studies.run_study import run_study
from siren_ros.running.studies.study_folder import LocalFolder, attempt_folder, hashes_of_bag, read_table

STUDY = Study(("S2",), ("L0", "L2"), seeds=(3,))
WRITES = {"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.symlink", "shutil.rmtree"}
left = -1  # how many writes the process has; without a bound if negative

def counts(event, arguments):
    global left
    writes = event in WRITES or (event == "open" and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    if writes and left >= 0:
        left -= 1
        if left < 0:
            os._exit(9)

class Makers:
    def rows(self, planned, folder, options):
        for episode in planned:
            with attempt_folder(folder) as scratch:
                bag = scratch / "bag"
                bag.mkdir()
                (bag / "bag_0.mcap").write_text(episode.name)
                (bag / "metadata.yaml").write_text(episode.group)
                made = EpisodeRow.planned(episode, Status.COMPLETE)
                storage, metadata = hashes_of_bag(bag)
                row = EpisodeRow.planned(
                    episode, Status.COMPLETE, bag=made.path, mcap_sha256=storage, metadata_sha256=metadata
                )
                folder.take(bag, row)
            yield row

def outcome(root):
    folder = LocalFolder(root)
    result = run_study(STUDY, folder, Makers())
    # A write that died leaves its hidden file.
    paths = (path for path in sorted(root.rglob("*")) if path.is_file() and path.name[0] != ".")
    files = {str(path.relative_to(root)): path.read_bytes() for path in paths}
    assert sorted(result.rows, key=lambda row: row.episode) == list(read_table(folder))
    return result.rows, files

with tempfile.TemporaryDirectory() as whole:
    wanted = outcome(Path(whole))
sys.addaudithook(counts)
for deaths in range(500):
    with tempfile.TemporaryDirectory() as root:
        child = os.fork()
        if child == 0:
            left = deaths
            run_study(STUDY, LocalFolder(Path(root)), Makers())
            os._exit(0)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        assert outcome(Path(root)) == wanted, f"after {deaths} writes"
    if code == 0:
        print(deaths)
        break
    assert code == 9
"""


def test_a_study_that_dies_before_any_of_its_writes_has_the_same_episodes_afterwards() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20
