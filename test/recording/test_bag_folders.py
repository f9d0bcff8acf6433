from pathlib import Path

from siren_ros.recording.bag_folders import bags_among


def made(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "0.mcap").touch()
    return folder


def test_a_folder_of_bags_stands_for_them(tmp_path: Path) -> None:
    single, second, first = made(tmp_path / "x"), made(tmp_path / "many" / "b"), made(tmp_path / "many" / "a")
    made(tmp_path / "many" / ".unfinished")
    (tmp_path / "many" / "notes").mkdir()
    assert bags_among([single, tmp_path / "many"]) == (single, first, second)


def test_what_holds_no_bag_stays_as_it_is(tmp_path: Path) -> None:
    assert bags_among([tmp_path, tmp_path / "none"]) == (tmp_path, tmp_path / "none")


def test_bags_are_found_at_any_depth_and_not_in_hidden_folders(tmp_path: Path) -> None:
    for name in ("b/deep/er", "a", ".work/half", "b/.x.partial"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "x_0.mcap").touch()
    assert bags_among([tmp_path]) == (tmp_path / "a", tmp_path / "b" / "deep" / "er")
