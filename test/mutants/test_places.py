"""Files, their tests, and the lines of a change."""

import subprocess

import pytest

from mutants.places import changed_lines_since, files_below, folder_of, mirror_of


def git(root, *arguments):
    identity = ["-c", "user.name=t", "-c", "user.email=t@example.org"]
    subprocess.run(["git", *identity, *arguments], cwd=root, check=True, capture_output=True)


@pytest.mark.parametrize(
    ("file", "package", "tests", "mirror"),
    [
        ("lib/a/b/c.py", "lib/a", "test/a", "test/a/b/test_c.py"),
        ("lib/a/c.py", "lib/a", "test/a", "test/a/test_c.py"),
        ("lib/c.py", "lib/c.py", "test/test_c.py", "test/test_c.py"),
    ],
)
def test_the_tests_of_a_file_are_in_the_folder_of_the_same_name(file, package, tests, mirror):
    assert (folder_of(file).package, folder_of(file).tests, mirror_of(file)) == (package, tests, mirror)


def test_files_below_folders_without_those_of_packages(tmp_path):
    for name in ("a/__init__.py", "a/one.py", "a/b/two.py", "c.py", "a/text.txt"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    assert files_below(tmp_path, ["a"]) == ["a/b/two.py", "a/one.py"]
    assert files_below(tmp_path, ["c.py", "a/one.py"]) == ["a/one.py", "c.py"]
    with pytest.raises(FileNotFoundError, match="nowhere"):
        files_below(tmp_path, ["nowhere"])


def test_lines_of_a_change_are_those_of_the_present_text(tmp_path):
    git(tmp_path, "init", "-q")
    file = tmp_path / "a.py"
    file.write_text("one\ntwo\nthree\nfour\n")
    (tmp_path / "b.py").write_text("one\n")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "first")
    file.write_text("zero\none\nTWO\nthree\n")
    (tmp_path / "b.py").unlink()
    assert changed_lines_since(tmp_path, "HEAD") == {"a.py": {1, 3}}
    with pytest.raises(ValueError, match="nowhere"):
        changed_lines_since(tmp_path, "nowhere")
